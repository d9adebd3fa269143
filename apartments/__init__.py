"""The built-in scenes: procedurally furnished buildings, virtually scanned."""

from .config import BUILDINGS, ApartmentConfig, ScanConfig, building_config
from .exact import generate_exact
from .generate import generate_scan
from .home.building import build_scene
from .home.true_scene import TrueScene

__all__ = [
    "BUILDINGS",
    "ApartmentConfig",
    "ScanConfig",
    "TrueScene",
    "build_scene",
    "building_config",
    "generate_exact",
    "generate_scan",
]
