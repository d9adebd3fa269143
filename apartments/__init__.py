"""The built-in scenes: procedurally furnished buildings, virtually scanned."""

from .building.build import build_scene
from .building.true_scene import TrueScene
from .config import BUILDINGS, ApartmentConfig, ScanConfig, StairsConfig, building_config
from .exact import generate_exact
from .generate import generate_scan

__all__ = [
    "BUILDINGS",
    "ApartmentConfig",
    "ScanConfig",
    "StairsConfig",
    "TrueScene",
    "build_scene",
    "building_config",
    "generate_exact",
    "generate_scan",
]
