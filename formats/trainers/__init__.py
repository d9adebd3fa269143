"""Layouts that VLN models train on, written from episode units; see docs/reference/layouts.md."""
