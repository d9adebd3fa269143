"""Shared records, frames and every file format (layer 1: imports no other package)."""
