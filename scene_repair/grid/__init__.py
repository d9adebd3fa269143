"""The scan sampled on grids of cells."""
