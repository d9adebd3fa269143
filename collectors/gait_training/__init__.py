"""Training, evaluation and export of gaits."""
