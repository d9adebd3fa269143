"""The offline writer: texts from a path's facts, worded as a person would give directions."""

from .compose import Composed, compose_texts
from .realize import Usage

__all__ = ["Composed", "Usage", "compose_texts"]
