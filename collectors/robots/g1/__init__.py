"""Unitree's G1."""
