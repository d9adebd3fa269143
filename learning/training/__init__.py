"""Training: data, losses, scores, sessions that resume and held-out paths."""
