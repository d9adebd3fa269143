"""Command line, stages, jobs, stage runner and report (layer 4)."""
