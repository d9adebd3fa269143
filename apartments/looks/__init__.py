"""Procedural textures and the choice of materials."""
