"""Stages `look`, `name` and `instruct`: visibility, names of objects, texts."""
