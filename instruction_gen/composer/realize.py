"""Turn steps into sentences."""

import re
from collections.abc import Sequence

import numpy as np

from ..language.words import NUMBERS
from . import words
from .records import Step

_NUMBER = {round(n): w for w, n in reversed(NUMBERS.items()) if n == round(n)}
_SLOT = re.compile(r"\{(\w+)\}")
_SLIGHT_DEG, _SHARP_DEG, _ROUND_DEG = 52.0, 122.0, 155.0


def realize(steps: Sequence[Step], rng: np.random.Generator, style: str) -> tuple[str, list[str]]:
    """Return the text of some steps, and its sentences' skeletons, with slots for what varies."""
    clauses: list[str] = []
    memory: list[str] = []
    rooms: list[str] = []
    for step in steps:
        clause = _clause(step, rng, memory, rooms)
        clauses.append(clause)
        memory = [*memory[-2:], _plain(clause).split()[0]]
        rooms.append(step.room)
    leading = [step.kind in _LEADING for step in steps]
    sentences = _sentences(clauses, leading, rng, style)
    return " ".join(_plain(s) for s in sentences), [_skeleton(s) for s in sentences]


# Slots are kept as marks around their text until the end: «B|the kitchen».
def _fill(template: str, **slots: str) -> str:
    return _SLOT.sub(
        lambda m: slots[m[1]] if m[1] in ("turn", "side") else f"«{m[1]}|{slots[m[1]]}»", template
    )


_MARK = re.compile(r"«(\w+)\|([^»]*)»")


def _plain(marked: str) -> str:
    return _MARK.sub(lambda m: m[2], marked)


def _skeleton(marked: str) -> str:
    return _MARK.sub(lambda m: "{" + m[1] + "}", marked)


def _pick(options: Sequence[str], rng: np.random.Generator, memory: Sequence[str]) -> str:
    """Return the shorter of two at random, rather one that begins with no verb used just before.

    People are brief: without this the texts are a tenth longer.
    """
    fresh = [o for o in options if o.split()[0] not in memory]
    pool = fresh or list(options)
    first, second = (pool[int(k)] for k in rng.integers(len(pool), size=2))
    return min(first, second, key=lambda o: len(o.split()))


def _turn(step: Step, rng: np.random.Generator, memory: Sequence[str]) -> str:
    if step.degrees >= _ROUND_DEG:
        return _pick(words.AROUND, rng, ())
    if step.degrees < _SLIGHT_DEG:
        options = words.SLIGHT
    else:
        options = words.SHARP if step.degrees > _SHARP_DEG else words.TURN
    return _fill(_pick(options, rng, memory), s=step.side)


def _clause(
    step: Step, rng: np.random.Generator, memory: Sequence[str], rooms: Sequence[str]
) -> str:
    room = f"the {step.room}" if step.room else "the next room"
    slots = {"B": room, "A": f"the {step.from_room}", "s": step.side}
    return _MAKERS[step.kind](step, rng, memory, slots, rooms)


def _make_turn(step, rng, memory, slots, rooms) -> str:
    turn = _turn(step, rng, memory)
    if step.mark is None:
        return turn
    turn = turn.removesuffix(" and keep going")
    return _fill(_pick(words.TURN_AT, rng, ()), turn=turn, X=step.mark.words)


def _make_leave(step, rng, memory, slots, rooms) -> str:
    if not step.room:
        return _fill(_pick(words.LEAVE_UNKNOWN, rng, memory), **slots)
    options = words.LEAVE + (words.LEAVE_DOOR if step.doorway else ())
    return _fill(_pick(options, rng, memory), **slots)


def _make_enter(step, rng, memory, slots, rooms) -> str:
    options = words.ENTER + (words.ENTER_DOOR if step.doorway else ())
    return _fill(_pick(options, rng, memory), **slots)


def _make_turn_enter(step, rng, memory, slots, rooms) -> str:
    slight = step.degrees < _SLIGHT_DEG
    options = words.SLIGHT_ENTER if slight else words.TURN_ENTER
    if step.doorway and not slight:
        options = options + words.TURN_ENTER_DOOR
    if step.from_room and not slight:
        options = options + words.LEAVE_TURN_ENTER
    return _fill(_pick(options, rng, memory), **slots)


def _make_enter_turn(step, rng, memory, slots, rooms) -> str:
    options = words.LEAVE_THEN if step.from_room and step.room else words.ENTER_THEN
    turn = _turn(step, rng, ()).removesuffix(" and keep going")
    return _fill(_pick(options, rng, memory), turn=turn, **slots)


def _make_pass(step, rng, memory, slots, rooms) -> str:
    thing = step.mark.words
    if step.side and rng.random() < 0.3:
        return _fill(_pick(words.PASS_SIDE, rng, memory), X=thing, s=step.side)
    ways = (" on your {s}", " on the {s}", " to your {s}", " on your {s}-hand side")
    weights = np.array([0.5, 0.3, 0.12, 0.08])
    side = _fill(str(rng.choice(ways, p=weights)), s=step.side) if step.side else ""
    return _fill(_pick(words.PASS, rng, memory), X=thing, side=side)


def _make_between(step, rng, memory, slots, rooms) -> str:
    return _fill(_pick(words.BETWEEN, rng, memory), X=step.mark.words, Y=step.other.words)


def _make_follow(step, rng, memory, slots, rooms) -> str:
    return _fill(_pick(words.FOLLOW, rng, memory), **slots)


def _ways(options: Sequence[str], step: Step) -> Sequence[str]:
    """Return the words for a way; a bent one is not straight."""
    return [o for o in options if "straight" not in o] if step.bent else options


def _make_ahead(step, rng, memory, slots, rooms) -> str:
    return _pick(_ways(words.AHEAD, step), rng, memory)


def _make_walk(step, rng, memory, slots, rooms) -> str:
    options = words.WALK_SHORT if step.far_m < 2.3 and rng.random() < 0.6 else words.WALK
    return _fill(_pick(_ways(options, step), rng, memory), n=metres(step.far_m))


def _make_stop(step, rng, memory, slots, rooms) -> str:
    if step.place == "after":
        options = words.AFTER if step.far_m >= 1.5 else words.AFTER_SHORT
        return _fill(_pick(_ways(options, step), rng, memory), n=metres(step.far_m))
    verb = _pick(words.STOP, rng, ())
    if step.place == "outside":
        return f"{verb} {_fill(_pick(words.OUTSIDE, rng, ()), **slots)}"
    if step.place == "inside":
        named = bool(rooms) and rooms[-1] == step.room
        options = words.INSIDE[1:2] if named else words.INSIDE
        return f"{verb} {_fill(_pick(options, rng, ()), **slots)}"
    thing = step.mark.words
    if step.place == "between":
        return f"{verb} {_fill('between {X} and {Y}', X=thing, Y=step.other.words)}"
    if step.side and rng.random() < 0.75:
        return f"{verb} {_fill(_pick(words.STOP_SIDE, rng, ()), X=thing, s=step.side)}".replace(
            " is on", " are on" if step.mark.plural else " is on"
        )
    if step.place == "front" and rng.random() < 0.35:
        text = _fill(_pick(words.REACH_STOP, rng, memory), X=thing)
        return text.replace("front of it", "front of them") if step.mark.plural else text
    options = {
        "front": words.FRONT, "beside": words.BESIDE, "near": words.NEAR, "past": words.PAST,
    }[step.place]  # fmt: skip
    return f"{verb} {_fill(_pick(options, rng, ()), X=thing)}"


_MAKERS = {
    "turn": _make_turn,
    "leave": _make_leave,
    "enter": _make_enter,
    "turn_enter": _make_turn_enter,
    "enter_turn": _make_enter_turn,
    "pass": _make_pass,
    "between": _make_between,
    "follow": _make_follow,
    "ahead": _make_ahead,
    "walk": _make_walk,
    "stop": _make_stop,
}


def metres(distance_m: float) -> str:
    """Return about how far, in words: `four metres`."""
    whole = max(1, round(distance_m))
    return f"{_NUMBER.get(whole, str(whole))} metre" + ("" if whole == 1 else "s")


# "Walk on for two metres." says too little for a sentence: what it leads to goes with it.
_LEADING = frozenset(("walk", "follow", "ahead"))


def _sentences(
    clauses: list[str], leading: Sequence[bool], rng: np.random.Generator, style: str
) -> list[str]:
    """Join clauses into sentences; no sentence carries more than three actions.

    Two sentences of one clause do not follow each other, and no sentence ends with a clause that
    is `leading` (N,).
    """
    groups: list[list[str]] = []
    rest = list(clauses)
    longest = {"terse": 2, "natural": 3, "rich": 3}[style]
    while rest:
        size = min(len(rest), int(rng.integers(1, longest + 1)))
        weight = 0
        for k, clause in enumerate(rest[:size]):
            weight += 1 + (" and " in _plain(clause)) + (", " in _plain(clause))
            if weight > 3 and k:
                size = k
                break
        done = len(clauses) - len(rest)
        short = bool(groups) and len(groups[-1]) == 1 and size == 1
        if len(rest) > size and (short or leading[done + size - 1]):
            size += 1
        groups.append(rest[:size])
        rest = rest[size:]
    result = []
    opened = False  # one "after that" is enough for a text
    for k, group in enumerate(groups):
        text = _join(group, rng)
        repeated = "then" in _plain(text).split()  # "then … then" reads like a list
        standing = text.startswith(_STANDING) or repeated
        if k and not opened and not standing and rng.random() < _OPENED:
            opened = True
            text = str(rng.choice(words.THEN)) + text
        plain = _plain(text)
        result.append(text if plain[0].isupper() else _upper(text))
        result[-1] += "."
    return result


_OPENED = 0.3
_STANDING = ("at ", "once ", "when ", "as ", "stop", "wait", "come")


_JOINTS = (", then ", " and ", ", then ", " and ")


def _join(group: Sequence[str], rng: np.random.Generator) -> str:
    text = group[0]
    for k, clause in enumerate(group[1:], start=1):
        last = k == len(group) - 1
        loaded = " and " in _plain(text).split(", ")[-1] or " and " in _plain(clause)
        if not last:
            joint = ", "
        elif loaded or "," in _plain(text):
            joint = ", then "  # no "leave the hall and turn left, and stop"
        elif clause.startswith(("at ", "once ", "when ", "as ")):
            joint = ", and "
        else:
            joint = str(rng.choice(_JOINTS))
        text += joint + clause
    return text


def _upper(marked: str) -> str:
    """Capitalise the first letter outside of the marks."""
    if marked.startswith("«"):
        cut = marked.index("|") + 1
        return marked[:cut] + marked[cut].upper() + marked[cut + 1 :]
    return marked[0].upper() + marked[1:]
