"""A scan in, a simulation-ready scene out (floor 2)."""
