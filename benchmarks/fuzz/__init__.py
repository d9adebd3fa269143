"""Coverage-guided fuzzing of every reader of files that somebody else may have made."""
