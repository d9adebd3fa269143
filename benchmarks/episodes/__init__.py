"""How fast episodes are read, sampled and divided."""
