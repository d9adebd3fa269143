"""Robots, controllers, locomotion policies, physics replay and rendering (layer 2)."""
