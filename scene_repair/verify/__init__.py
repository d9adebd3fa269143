"""Checks of the files that were written."""
