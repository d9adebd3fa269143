"""The train-free policy `map`: an online semantic map, and the instruction followed on it."""
