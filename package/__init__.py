"""Scanned buildings in, cross-embodiment Vision-and-Language Navigation datasets out."""

from importlib.metadata import version
from pathlib import Path

__version__ = version("vlnpe")

_FOLDER = Path(__file__).parent
if _FOLDER.name == "package":  # A checkout, where the sub-packages are the folders beside it.
    __path__.append(str(_FOLDER.parent))
