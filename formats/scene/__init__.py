"""The repaired scene on disk: bundle, grids and planning maps."""
