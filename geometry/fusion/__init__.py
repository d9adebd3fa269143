"""Fuse depth images into a surface."""
