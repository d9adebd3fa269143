"""Textures of filled floor."""
