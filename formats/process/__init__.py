"""How code runs: digests of its source, compiled kernels, threads and progress."""
