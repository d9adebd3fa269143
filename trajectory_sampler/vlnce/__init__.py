"""Episodes of VLN-CE files: the stair filter, and their alignment with repaired scenes."""
