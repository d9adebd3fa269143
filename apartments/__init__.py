"""The built-in scene: a procedurally furnished apartment, virtually scanned."""

from .config import ApartmentConfig, ScanConfig
from .generate import generate_scan
from .home.apartment import build_apartment
from .home.true_scene import TrueScene

__all__ = ["ApartmentConfig", "ScanConfig", "TrueScene", "build_apartment", "generate_scan"]
