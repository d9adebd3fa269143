"""Rendering of RGB and metric depth from recorded states of a robot in a scene."""
