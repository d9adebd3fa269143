"""Commands on recipes and models: mix, train, ablate."""
