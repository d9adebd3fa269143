"""Learned policies: models, training, checkpoints, and comparisons of training data."""
