"""Obstacles and free space of a level."""
