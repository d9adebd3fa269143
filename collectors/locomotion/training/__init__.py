"""Training and export of gaits."""
