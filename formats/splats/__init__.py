"""Gaussian splats: readers and writers of their file formats.

All readers raise `FileFormatError` for a file that is missing, damaged, of another kind, or without
usable Gaussians.
"""
