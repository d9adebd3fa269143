"""The fuzzer's targets: one reader each, with small sound files to begin from."""

from .datasets import DATASETS
from .policies import POLICIES
from .scans import SCANS
from .target import Target

__all__ = ["TARGETS", "Target"]

TARGETS = {**SCANS, **DATASETS, **POLICIES}
