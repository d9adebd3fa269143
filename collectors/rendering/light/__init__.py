"""Lights, and what of them is computed once per scene."""
