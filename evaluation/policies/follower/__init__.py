"""Finds where a text leads on a map: its sub-goals, the ways, and their costs."""
