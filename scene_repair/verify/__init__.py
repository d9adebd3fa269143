"""Check the files that were written."""
