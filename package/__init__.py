"""Scanned buildings in, cross-embodiment Vision-and-Language Navigation datasets out."""

from importlib.metadata import version

__version__ = version("vlnpe")
