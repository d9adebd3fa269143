"""Check a text and its claims against the facts of its path."""

from .check import Verdict, check_text
from .ground import Ground

__all__ = ["Ground", "Verdict", "check_text"]
