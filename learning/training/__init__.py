"""Training: data, losses, scores, sessions that resume, held-out paths and corrections."""
