"""Gaits for stairs: learned on top of a finished gait, on lanes of flights."""
