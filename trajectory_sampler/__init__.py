"""Freemap planning, trajectory sampling, Habitat alignment and the stair filter (floor 2)."""
