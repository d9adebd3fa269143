"""Commands on policies: evaluate, compare, benchmark, serve, dagger."""
