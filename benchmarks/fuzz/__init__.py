"""Coverage-guided fuzzing of every reader of untrusted files."""
