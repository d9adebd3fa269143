"""Gaussian splats: the record and its file formats."""
