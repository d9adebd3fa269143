"""Conversion between dataset formats: items and jobs."""
