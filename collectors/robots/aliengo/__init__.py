"""Unitree's Aliengo."""
