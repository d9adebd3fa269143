"""Learned locomotion: policies that track velocity commands, their training and evaluation."""

from .policy import GaitPolicy, PolicyMismatchError

__all__ = ["GaitPolicy", "PolicyMismatchError"]
