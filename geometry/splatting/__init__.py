"""Draw Gaussian splats on the CPU."""
