"""The stages of `vlnpe collect`, in order: from scans to episodes, from episodes to datasets."""
