"""Pixels from recorded states: RGB and metric depth of a scene and a robot in it."""
