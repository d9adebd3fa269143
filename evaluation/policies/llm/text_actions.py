"""Actions in words, as vision-language navigators give them: "move forward 75 cm", "turn left 30°".

NaVid (Zhang et al., RSS 2024) and its successors answer in such sentences. A text that is
not plainly one or several actions is refused rather than guessed, so that it can be counted.
"""

import re

from ....formats.core.rollout import Action

FORWARD_CM, TURN_DEG = 25.0, 15.0
MOST_CM, MOST_DEG = 500.0, 360.0  # no single step of a walk is longer

_NUMBER = r"(?P<{0}>\d+(?:\.\d+)?)"
_LENGTH = r"\s*(?P<{0}>centimet(?:er|re)s?|cms?|met(?:er|re)s?|m)\b"
_ANGLE = r"\s*-?\s*(?:degrees?|deg|°)"
_PHRASE = re.compile(
    r"\bforwards?\s+(?:for\s+|by\s+)?" + _NUMBER.format("f1") + _LENGTH.format("u1")
    + r"|" + _NUMBER.format("f2") + _LENGTH.format("u2") + r"\s+(?:straight\s+)?forwards?\b"
    + r"|\b(?:turn|rotate)\s+(?:to\s+(?:the\s+)?)?(?P<s1>left|right)\s+(?:by\s+|for\s+)?"
    + _NUMBER.format("a1") + _ANGLE
    + r"|\b(?:turn|rotate)\s+(?:by\s+)?" + _NUMBER.format("a2") + _ANGLE
    + r"\s+(?:to\s+(?:the\s+)?)?(?P<s2>left|right)\b"
    + r"|(?P<stop>\bstop\b)"
)  # fmt: skip
# Words that turn a phrase into something else than an order.
_DOUBT = re.compile(r"\b(?:not|don't|never|no|or|if|unless|until|before|cannot|can't|without)\b")
# What speaks of acting; left over, it was an action that was not understood.
_LEFT = re.compile(r"\b(?:turn|rotate|forwards?|backwards?|left|right|walk|go)\b|\d")


def parse_actions(text: str) -> list[Action]:
    """Return the actions that a sentence asks for, in order.

    Lengths are rounded to whole steps of 0.25 m, angles to steps of 15°, at least one. Nothing
    follows a stop.

    Raises:
        ValueError: the text asks for no action, for another kind of action, or is ambiguous.
    """
    words = " ".join(text.lower().replace("’", "'").split())
    if doubt := _DOUBT.search(words):
        raise ValueError(f"{doubt.group()!r} is ambiguous: {text!r:.120}")
    phrases = list(_PHRASE.finditer(words))
    rest = _PHRASE.sub(" ", words)
    if not phrases:
        raise ValueError(f"asks for no action: {text!r:.120}")
    if left := _LEFT.search(rest):
        raise ValueError(f"{left.group()!r} is not understood: {text!r:.120}")
    actions: list[Action] = []
    for match in phrases:
        actions += _actions(match, text)
        if actions[-1] is Action.STOP:
            break
    return actions


def _actions(match: re.Match[str], text: str) -> list[Action]:
    if match["stop"]:
        return [Action.STOP]
    if side := match["s1"] or match["s2"]:
        value, step, most = float(match["a1"] or match["a2"]), TURN_DEG, MOST_DEG
        action = Action.LEFT if side == "left" else Action.RIGHT
    else:
        value, unit = float(match["f1"] or match["f2"]), match["u1"] or match["u2"]
        value *= 1.0 if unit.startswith("c") else 100.0
        step, most, action = FORWARD_CM, MOST_CM, Action.FORWARD
    if not 0 < value <= most:
        raise ValueError(f"{value:g} is not a length or angle of a step: {text!r:.120}")
    return [action] * max(1, round(value / step))
