"""Command line, configuration, stage runner, manifests and the report (floor 3)."""
