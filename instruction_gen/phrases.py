"""The English of the offline composer: word choices for each kind of step."""

from __future__ import annotations

import numpy as np

from .actions import Turn

_NUMBERS = dict(
    enumerate(
        ["zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"]
    )
)
_CAPITALS = {"tv": "TV", "pc": "PC", "led": "LED"}
_IRREGULAR = {"shelf": "shelves", "bookshelf": "bookshelves", "bench": "benches"}


def pick(rng: np.random.Generator, options: list[str]) -> str:
    """One of `options`, at random."""
    return options[int(rng.integers(len(options)))]


def thing(category: str, plural: bool = False) -> str:
    """`tv cabinet` → `the TV cabinet`, several → `the TV cabinets`."""
    words = [_CAPITALS.get(w, w) for w in category.replace("_", " ").split()]
    if plural:
        last = words[-1]
        if last in _IRREGULAR:
            words[-1] = _IRREGULAR[last]
        elif last.endswith(("s", "x", "ch", "sh")):
            words[-1] = last + "es"
        else:
            words[-1] = last + "s"
    return "the " + " ".join(words)


def room(name: str, unknown: str = "the room") -> str:
    """`kitchen` → `the kitchen`; a room nobody can name gets `unknown`."""
    return f"the {name}" if name else unknown


def metres(distance_m: float) -> str:
    """About how far, in words: `four metres`."""
    whole = max(1, round(distance_m))
    number = _NUMBERS.get(whole, str(whole))
    return f"{number} metre" + ("" if whole == 1 else "s")


def turn(rng: np.random.Generator, step: Turn) -> str:
    """`turn left`, in words that fit how far."""
    side, degrees = step.direction, abs(np.rad2deg(step.angle_rad))
    if degrees < 52:
        return pick(
            rng,
            [f"bear {side}", f"turn slightly {side}", f"veer to the {side}", f"angle {side}"],
        )
    if degrees < 125:
        return pick(
            rng,
            [f"turn {side}", f"take a {side}", f"make a {side} turn", f"turn to the {side}"],
        )
    if degrees < 160:
        return pick(rng, [f"make a sharp {side} turn", f"turn sharply {side}"])
    return pick(rng, ["turn around", "turn all the way around"])


def straight(rng: np.random.Generator, distance_m: float) -> str:
    """Walk on for a distance."""
    far = metres(distance_m)
    return pick(
        rng,
        [
            f"walk forward about {far}",
            f"go straight for about {far}",
            f"continue straight for roughly {far}",
            f"keep going for about {far}",
        ],
    )


def passing(rng: np.random.Generator, what: str, side: str) -> str:
    """Walk past a thing."""
    verb = pick(rng, ["walk past", "pass", "go past", "continue past"])
    where = pick(rng, [f" on your {side}", f" on the {side}"]) if side else ""
    return f"{verb} {what}{where}"


def enter(rng: np.random.Generator, to_room: str, doorway: bool) -> str:
    """Change rooms; `to_room` may be empty."""
    into = room(to_room, "the next room")
    if doorway:
        return pick(
            rng,
            [
                f"go through the doorway into {into}",
                f"walk through the doorway into {into}",
                f"pass through the doorway and enter {into}",
            ],
        )
    return pick(rng, [f"walk into {into}", f"enter {into}", f"continue into {into}"])


def leave(rng: np.random.Generator, from_room: str, to_room: str, doorway: bool) -> str:
    """Set off by leaving a room; `to_room` may be empty."""
    out = room(from_room)
    through = " through the doorway" if doorway and rng.random() < 0.6 else ""
    if not to_room:
        verb = pick(rng, ["leave", "exit", "walk out of"])
        return f"{verb} {out}{through or pick(rng, ['', ' into the next room'])}"
    into = room(to_room)
    return pick(
        rng,
        [
            f"walk out of {out}{through} into {into}",
            f"leave {out}{through} and enter {into}",
            f"exit {out}{through} and walk into {into}",
            f"go from {out}{through} into {into}",
        ],
    )


def stop(rng: np.random.Generator, where: str) -> str:
    """The last step."""
    return f"{pick(rng, ['stop', 'wait', 'come to a stop', 'stop'])} {where}"


def stop_after(rng: np.random.Generator, distance_m: float, first: bool) -> str:
    """The last step, where only a distance says when to stop."""
    far = metres(distance_m)
    if first:
        return pick(
            rng,
            [
                f"walk straight ahead for about {far} and stop there",
                f"go forward about {far} and come to a stop there",
            ],
        )
    if distance_m < 0.7:
        return pick(rng, ["stop right there", "stop there"])
    return pick(
        rng,
        [
            f"walk about {far} further and stop",
            f"stop after about {far}",
            f"go on for about {far} and stop there",
        ],
    )
