"""Shared records, frames and every file format (floor 1: imports no other room)."""
