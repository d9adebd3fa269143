"""A scan in, a simulation-ready scene out (layer 2)."""
