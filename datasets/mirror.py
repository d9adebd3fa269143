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
_PAIRS = (
    ("left", "right"), ("leftmost", "rightmost"), ("leftward", "rightward"),
    ("leftwards", "rightwards"), ("lefthand", "righthand"), ("clockwise", "anticlockwise"),
)  # fmt: skip
_OTHER = {a: b for pair in _PAIRS for a, b in (pair, pair[::-1])}
_SIDE = re.compile(rf"\b({'|'.join(_OTHER)}|(?:anti|counter)-?clockwise)\b", re.IGNORECASE)
# Here "right" is a side, whatever follows.
_SURE = re.compile(
    r"\b(?:turn|turning|bear|bearing|veer|veering|bend|curve|swing|slightly|gently|sharply|the|your"
    r"|a|another)\s+right\b(?!\s+(?:away|now|up|angles?)\b)",
    re.IGNORECASE,
)
# Where "left" or "right" may be no side: "the room you left", "stop right there", "right away".
_DOUBTFUL = re.compile(
    r"\b(?:you|you've|you'd|we|have|had|just|all)\s+(?:left|right)\b"
    r"|\bleft\s+(?:the|a|an|your|it|that|this)\b"
    r"|\bright\s+(?:above|across|after|against|ahead|along|angles?|around|as|at|away|back|before"
    r"|behind|beside|between|beyond|by|down|here|in|inside|near|next|now|off|on|opposite|outside"
    r"|over|past|round|there|through|under|until|up|when|where)\b",
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


def mirror_text(text: str) -> str | None:
    """Return an English instruction with its sides swapped; None where that is not safe.

    That is so where "left" or "right" may be no side, and in other scripts than the Latin one.
    """
    if not text.isascii() or _DOUBTFUL.search(_SURE.sub(";", text)):
        return None
    return _SIDE.sub(_other_side, text)


def _other_side(match: re.Match[str]) -> str:
    side = match[0]
    other = _OTHER.get(side.lower(), "clockwise")
    return other.capitalize() if side[0].isupper() else other
