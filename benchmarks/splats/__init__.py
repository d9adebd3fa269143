"""Splats: speed of the rasteriser, and geometry of repaired captures."""
