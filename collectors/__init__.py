"""Robots, controllers, locomotion policies, physics replay and rendering (floor 2)."""
