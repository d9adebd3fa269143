"""Holes and decoys cut into scenes whose floors are known."""
