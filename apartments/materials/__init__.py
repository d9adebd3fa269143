"""Textures painted by code, and the choice of materials."""
