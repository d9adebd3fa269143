"""The offline writer: texts from a path's facts, worded as a person would give directions."""

from .compose import compose_texts
from .realize import Usage

__all__ = ["Usage", "compose_texts"]
