"""Lights, and the parts of their illumination that are computed once per scene."""
