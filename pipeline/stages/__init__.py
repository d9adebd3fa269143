"""One module per stage: its work items and how one is processed."""
