"""Mixtures of datasets for co-training: which episodes, in which shares, in which order."""
