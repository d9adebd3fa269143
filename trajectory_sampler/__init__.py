"""Trajectory sampling, alignment of VLN-CE episodes and the stair filter (layer 2)."""
