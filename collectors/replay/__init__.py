"""Episodes walked in physics, their outcomes and metrics."""
