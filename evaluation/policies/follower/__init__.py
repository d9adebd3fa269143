"""Where a text leads on a map: its sub-goals, the ways, and what they cost."""
