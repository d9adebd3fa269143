"""Stage runner, ledger, keys and worker processes."""
