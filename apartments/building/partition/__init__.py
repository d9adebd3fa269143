"""Partitions: how the rectangle of a storey falls into rooms."""
