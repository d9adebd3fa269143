"""Ablations: train a compact agent on each mixture of a recipe and predict held-out episodes."""
