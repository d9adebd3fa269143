"""The offline writer: texts from a path's facts, worded as a person would give directions."""

from .compose import Composed, compose_texts

__all__ = ["Composed", "compose_texts"]
