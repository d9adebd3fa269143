"""Aligned, filtered and sampled episodes: items and jobs."""
