"""What an instruction claims: steps of words, each with claims of a closed schema."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from ...formats.core.errors import InputError, UnknownNameError

# What a claim says: the walker leaves or enters a room or is in it, goes through a door, turns,
# takes stairs, passes, sees or reaches a thing, walks a distance, stops, or does not enter a room
# or take stairs.
KINDS = (
    "leave", "enter", "in", "door", "turn", "climb", "pass", "see", "reach", "walk", "stop",
    "avoid",
)  # fmt: skip
WHAT = ("", "thing", "room", "door", "storey")
SIDES = ("", "left", "right", "ahead", "behind", "around")
# Where a stop is with respect to its target; the last are on stairs.
PLACES = (
    "", "at", "before", "past", "inside", "outside", "doorway", "between", "top", "bottom",
    "halfway",
)  # fmt: skip
DEGREES = ("", "slight", "sharp")
UP_DOWN = ("", "up", "down")


@dataclass(frozen=True)
class Claim:
    """One thing that must hold, after what was claimed before it.

    Attributes:
        kind: one of `KINDS`.
        what: one of `WHAT`, the kind of the target; "" = none is named.
        name: singular phrase of the target: `coffee table`, `hallway`; "" of any door or room;
            `opening` of one that may be wider than a doorway.
        side: one of `SIDES`, of a turn, or where the target is.
        ordinal: place of the target among its like, from 1; 0 = not stated, −1 = last.
        count: how many there are; 0 = not stated.
        colour, material: of the target.
        room: the room that the target stands in or that a door leads to.
        metres: of a walk [m].
        vague: a distance of a few steps or metres.
        place: one of `PLACES`, of a stop or on stairs.
        degree: one of `DEGREES`, of a turn.
        way: one of `UP_DOWN`, of a climb.
    """

    kind: str
    what: str = ""
    name: str = ""
    side: str = ""
    ordinal: int = 0
    count: int = 0
    colour: str = ""
    material: str = ""
    room: str = ""
    metres: float = 0.0
    vague: bool = False
    place: str = ""
    degree: str = ""
    way: str = ""

    def __post_init__(self) -> None:
        for field, valid in _CLOSED.items():
            if getattr(self, field) not in valid:
                raise UnknownNameError(f"claim's {field}", getattr(self, field), valid)

    @property
    def text(self) -> str:
        """The target in words."""
        words = [self.colour, self.material, self.name or self.what]
        return " ".join(w for w in words if w)


_CLOSED = {
    "kind": KINDS, "what": WHAT, "side": SIDES, "place": PLACES, "degree": DEGREES, "way": UP_DOWN,
}  # fmt: skip
_TYPES: dict[str, type] = {f.name: type(f.default) for f in fields(Claim)} | {"kind": str}


@dataclass(frozen=True)
class Step:
    """Words and what they claim.

    Attributes:
        words: of the step, as they stand in the text.
        claims: in order.
        start: where the words begin in the text.
        unchecked: words of the step that no claim covers.
        faults: what is wrong with the words whatever the path is.
    """

    words: str
    claims: tuple[Claim, ...]
    start: int = 0
    unchecked: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()


def claim_record(claim: Claim) -> dict[str, Any]:
    """Return the claim as JSON, without what it leaves open."""
    return {f.name: v for f in fields(Claim) if (v := getattr(claim, f.name)) != f.default}


def step_record(step: Step) -> dict[str, Any]:
    """Return the words and claims of a step as JSON, as `read_steps` takes them."""
    return {"words": step.words, "claims": [claim_record(claim) for claim in step.claims]}


def claims_schema() -> dict[str, Any]:
    """Return the JSON Schema of a list of claims, as servers with structured output take it."""
    kinds = {str: "string", int: "integer", float: "number", bool: "boolean"}
    keys = {
        name: {"enum": list(_CLOSED[name])} if name in _CLOSED else {"type": kinds[of]}
        for name, of in _TYPES.items()
    }
    claim = {
        "type": "object", "properties": keys, "required": ["kind"], "additionalProperties": False,
    }  # fmt: skip
    return {"type": "array", "items": claim}


def read_steps(records: Any) -> tuple[Step, ...]:
    """Return steps from JSON: `[{"words": …, "claims": [{"kind": …}, …]}, …]`.

    Raises:
        InputError: the record does not have this form; the message names the bad value.
    """
    if not isinstance(records, list):
        raise InputError(f"claims {records!r:.60}; valid: a list of steps")
    return tuple(_step(record) for record in records)


def _step(record: Any) -> Step:
    if not isinstance(record, Mapping) or set(record) - {"words", "claims"}:
        raise InputError(f"step {record!r:.80}; valid keys: words, claims")
    words, claims = record.get("words"), record.get("claims", [])
    if not isinstance(words, str) or not isinstance(claims, list):
        raise InputError(f"step {record!r:.80}; valid: words is a text, claims a list")
    return Step(words, tuple(_claim(claim) for claim in claims))


def _claim(record: Any) -> Claim:
    if not isinstance(record, Mapping):
        raise InputError(f"claim {record!r:.80}; valid: an object")
    for key, value in record.items():
        if key not in _TYPES:
            raise UnknownNameError("key of a claim", str(key), tuple(_TYPES))
        valid = (int, float) if _TYPES[key] is float else _TYPES[key]
        if not isinstance(value, valid) or (isinstance(value, bool) and _TYPES[key] is not bool):
            raise InputError(f"claim's {key} {value!r:.40}; valid: {_TYPES[key].__name__}")
    if "kind" not in record:
        raise InputError(f"claim {dict(record)!r:.80} has no kind; valid: {', '.join(KINDS)}")
    # Names are written as a sentence has them: "TV stand".
    lower: dict[str, Any] = {k: v.lower() if isinstance(v, str) else v for k, v in record.items()}
    return Claim(**lower)
