"""Geometry of Gaussian splats: what is solid, where to look from, and the fused surface."""
