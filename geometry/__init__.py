"""Geometry that is no file format: rays, fusion of depth images, splatting."""
