"""Does a text say what is true of its path? Claim by claim, against the facts."""

from .check import Verdict, check_text
from .ground import Ground

__all__ = ["Ground", "Verdict", "check_text"]
