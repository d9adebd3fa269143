"""The offline writer: texts from a path's facts, as a person would tell the way."""

from .compose import Composed, compose_texts

__all__ = ["Composed", "compose_texts"]
