"""Sample the scan on grids of cells."""
