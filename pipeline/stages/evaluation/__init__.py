"""Closed-loop evaluation and its report: items and jobs."""
