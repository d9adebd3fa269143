"""Replayed and rendered rollouts: items and jobs."""
