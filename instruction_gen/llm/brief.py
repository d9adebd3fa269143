"""The facts as sent to a model, and the prompts with their hash."""

import hashlib
import json
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from ..composer.refer import came_by
from ..facts.records import LandmarkFact, PathFacts
from ..language.nouns import spoken

WRITING_PROMPTS = ("system", "claims", "examples", "repair", "back")
SIGHT_PROMPTS = ("sight", "room")  # of `--vision`

_NAMES = {"en": "English", "zh": "Chinese (simplified characters)", "hi": "Hindi"}
_PASSED_M = 2.2
_END_M = 2.0


def prompt(name: str) -> str:
    """Return a prompt's text."""
    return (files(__package__) / "prompts" / f"{name}.txt").read_text(encoding="utf-8")


@cache
def prompts_sha256(names: tuple[str, ...] = WRITING_PROMPTS) -> str:
    """Return the SHA-256 of some prompts, by default of those that ask for texts."""
    state = hashlib.sha256()
    for name in names:
        state.update(prompt(name).encode())
    return state.hexdigest()


def first_messages(facts: PathFacts, styles: Sequence[str], language: str) -> list[dict[str, str]]:
    """Return the request for one text in each of `styles`."""
    wish = (
        f"Write {len(styles)} instructions in {_NAMES[language]} (language {language!r}), "
        f"in these styles: {', '.join(styles)}. They must differ in wording."
    )
    return [
        {"role": "system", "content": "\n".join(map(prompt, ("system", "claims", "examples")))},
        {"role": "user", "content": f"Facts: {json.dumps(brief(facts))}\n{wish}"},
    ]


def repair_messages(
    before: Sequence[dict[str, str]], failed: Sequence[tuple[str, str, Sequence[str]]], attempt: int
) -> list[dict[str, str]]:
    """Return the request to write texts again; `failed` has style, text and problems of each."""
    wrong = [{"style": s, "text": t, "wrong": list(problems)} for s, t, problems in failed]
    # Its number keeps a second request for the same text from being answered by the cache.
    words = f"{prompt('repair')}Attempt {attempt}.\n{json.dumps(wrong, ensure_ascii=False)}"
    return [*before, {"role": "user", "content": words}]


def back_messages(text: str) -> list[dict[str, str]]:
    """Return the request to translate a text into English, with claims."""
    return [
        {"role": "system", "content": f"{prompt('back')}\n{prompt('claims')}"},
        {"role": "user", "content": text},
    ]


def brief(facts: PathFacts) -> dict[str, Any]:
    """Return the part of the facts that a text may need; labels are nouns of the lexicon here."""
    marks = [m for m in facts.landmarks if m.nameable]
    stairs = [
        {"after_m": round(c.along_m, 1), "until_m": round(c.to_m, 1), "way": c.way}
        for c in facts.climbs
    ]
    return {
        "length_m": round(facts.length_m),
        "rooms": [v.room or "a room" for v in facts.visits],
        "turns": [
            {"after_m": round(t.along_m, 1), "side": t.side, "angle": _angle(abs(t.angle_deg))}
            for t in facts.turns
            if abs(t.angle_deg) >= 35 and t.along_m < facts.length_m - 0.7
        ],
        **({"stairs": stairs} if stairs else {}),
        "doorways": [
            {"after_m": round(p.along_m, 1), "into": p.to_room or "the next room"}
            for p in facts.doors
        ],
        "passed": [
            {"after_m": round(m.along_m, 1), "side": m.side, "distance_m": m.distance_m} | _thing(m)
            for m in marks
            if m.distance_m <= _PASSED_M
            and m.side
            and m.along_m < facts.length_m - 0.6
            and came_by(m)
        ],
        "at_the_end": [
            {"where": _where(m.goal_bearing_deg), "distance_m": m.goal_distance_m} | _thing(m)
            for m in marks
            if m.goal_distance_m <= _END_M and m.goal_open and abs(m.goal_bearing_deg) <= 130
        ],
    }


def _thing(mark: LandmarkFact) -> dict[str, Any]:
    looks = {"colour": mark.colour, "material": mark.material}
    several = {"one_of": mark.count} if mark.count > 1 else {}
    return {"what": spoken(mark.noun)} | {k: v for k, v in looks.items() if v} | several


def _angle(degrees: float) -> str:
    return "slight" if degrees < 60 else "square" if degrees < 125 else "around"


def _where(bearing_deg: float) -> str:
    side = "left" if bearing_deg > 0 else "right"
    return "ahead" if abs(bearing_deg) < 35 else f"on the {side}"
