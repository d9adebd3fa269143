"""Mirrored episodes: what a walk would be in the mirrored building, with the words for its sides.

A mirrored home is one that no other walk has seen, so that few homes teach more.
"""

import re
from collections.abc import Mapping
from typing import Any

import torch

# Actions: STOP, FORWARD, LEFT, RIGHT; `previous_action` has a number before them for "none".
_ACTION = torch.tensor([0, 1, 3, 2])
_PREVIOUS = torch.tensor([0, 1, 2, 4, 3])
_FLIPPED = ("rgb", "depth")  # (…, W), images or an encoder's maps
_SIDEWAYS = ("motion", "pose", "waypoints")  # (…, 3): x forwards, y to the left, yaw
_OTHER = {"left": "right", "right": "left", "clockwise": "anticlockwise"}
_WHERE = (
    r"(?:in|beside|next|by|behind|before|after|past|there|here|at|inside|outside|opposite|when)\b"
)
_WORD = re.compile(
    # "right" is no side in "right away", "it is right beside you", "turn left right after".
    r"\bright\s+(?:away|now|up|angles?)\b"
    rf"|\b(?:is|are|be|(?:it|that)'s|you're|stop|wait|stand|just)\s+right\s+{_WHERE}"
    rf"|(?<=\bleft\s)right\s+{_WHERE}"
    r"|\b(?P<side>left|right|(?:anti|counter-?)?clockwise)\b",
    re.IGNORECASE,
)


def mirror_item(item: Mapping[str, Any]) -> dict[str, Any]:
    """Return an item of `EpisodeSequences` mirrored; its `tokens` stay, see `mirror_text`.

    An encoder's maps are flipped like images, though its maps of a flipped image differ a little.
    """
    result = dict(item)
    for key in _FLIPPED:
        if key in item:
            result[key] = item[key].flip(-1)
    for key in _SIDEWAYS:
        if key in item:
            result[key] = item[key] * item[key].new_tensor([1.0, -1.0, -1.0])
    result["action"] = _ACTION[item["action"]]
    result["previous_action"] = _PREVIOUS[item["previous_action"]]
    return result


def mirror_text(text: str) -> str:
    """Return an English instruction with its sides swapped."""
    return _WORD.sub(_other_side, text)


def _other_side(match: re.Match[str]) -> str:
    word = match["side"]
    if word is None:
        return match[0]
    other = _OTHER.get(word.lower(), "clockwise")
    return other.capitalize() if word[0].isupper() else other
