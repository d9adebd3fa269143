"""Benchmark of the instruct stage: lies rejected, true texts accepted, texts that lead there."""
