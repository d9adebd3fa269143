"""Scene and robot as arrays for the kernels."""
