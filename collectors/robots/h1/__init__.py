"""Unitree's H1."""
