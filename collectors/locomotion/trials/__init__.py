"""Trials of trained gaits on flat and rough ground: measures, gates, calibration."""
