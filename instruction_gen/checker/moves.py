"""What it costs to go from one place of a path to another by a claim."""

import numpy as np

from .fit import NEVER, WRONG, Costs, Fit, Part, ramp
from .ground import Ground
from .said import Said

_FIRST = 0.35  # who meets what costs no more than this means it
_STAYS_M = 4.0, 7.0


def _back(ground: Ground, said: Said) -> float:
    """Return how far behind the walker the place of a claim may be [m]."""
    kind, last = said.claim.kind, said.last.kind
    if kind == "climb" and (last == "climb" or said.last.what == "storey"):
        return max((c.to_m - c.along_m for c in ground.facts.climbs), default=0.0)
    if kind in ("pass", "in", "reach") and said.claim.what != "door" and said.paced_m:
        return said.paced_m + 0.5  # on that stretch
    if kind == "pass" and last in ("turn", "leave") and not said.apart:
        return 1.8  # "turn right after the bench", "leave the room past the bed"
    if kind == "door" and last == "turn":
        return 0.3
    if kind in ("pass", "reach") and last in ("enter", "door") and said.apart:
        return 0.2  # not what stands in the room before
    return {"pass": 0.0, "see": 4.0, "reach": 1.5}.get(kind, 0.9 if last == "turn" else 0.4)


def stays_m(said: Said) -> tuple[float, float] | None:
    """Return how far ahead the place of a claim may be that does not move the walker [m]."""
    claim, then = said.claim, said.following
    if claim.kind in ("pass", "in", "reach") and claim.what != "door" and said.paced_m:
        return 1.5, 3.0
    until = claim.kind == "see" and (then.kind, then.what) == ("stop", "")
    paced = claim.kind == "in" and then.kind == "walk" and then.metres > 0.0
    return _STAYS_M if paced or (claim.kind in ("see", "avoid") and not until) else None


def costs_to_move(
    ground: Ground, said: Said, fit: Fit, stays: tuple[float, float] | None
) -> list[tuple[Costs, str]]:
    """Return what it costs to go from one place (rows) to another (columns) by a claim."""
    claim, along, kind = said.claim, ground.along_m, said.claim.kind
    here, there, end = along[:, None], along[None, :], along[-1]
    went, led_to = there - here, said.led_to
    name = f"the {claim.text or 'doorway'}"
    back_m = _back(ground, said)
    parts: list[Part] = []

    def add(cost: Costs | float, reason: str) -> None:
        parts.append((cost, reason))

    add(
        ramp(-went, back_m, back_m + 0.6),
        f"{name} comes earlier on the path than the text says",
    )
    if stays:
        add(ramp(went, *stays), f"{name} comes later on the path than the text says")
    own = claim.ordinal or (claim.what == "door" and (claim.side or claim.room or claim.name))
    meant = kind == "door" or (claim.what == "thing" and kind in ("pass", "see", "reach"))
    if meant and not own:
        add(_beyond_first(ground, fit), f"the first {claim.text} on the way is another one")
    if (kind, claim.what) == ("pass", "room") == (said.last.kind, said.last.what):
        first_m = np.fmin.reduce(ground.doors_m(said.last), axis=0, initial=np.nan)
        then_m = np.fmax.reduce(ground.doors_m(claim), axis=0, initial=np.nan)
        other = then_m < first_m[:, None] - 0.5
        add(WRONG * other, f"{name} comes before the {said.last.name}")
    if kind == "walk" and (claim.metres or claim.vague) and not said.stopped:
        d = claim.metres
        low = np.minimum(0.2, end - 0.3 - here) if claim.vague else 0.85 * d - 0.2
        high = max(ground.few_m, 2.0 * d) if claim.vague else 1.15 * d + 0.15
        off = ramp(low - went, 0.0, 0.1 * d + 0.1), ramp(went - high, 0.0, 0.12 * d + 0.1)
        add(np.maximum(*off), f"the path does not go on for {d:g} metres")
    elif said.paced_m and (kind in ("door", "enter", "leave", "stop") or claim.what == "door"):
        add(ramp(np.abs(went), 0.1, 0.5), f"{name} is farther than the distance before it")
    if kind in ("enter", "door", "leave") and led_to.kind in ("door", "turn"):
        # One manoeuvre, which goes through no other room.
        if (led_to.kind == "door" and kind != "leave") or led_to.side == claim.side:
            add(ramp(went, 0.8, 1.8), f"{name} is not where the text turns or leads through")
        if kind != "leave":
            between = _rooms_before(ground, 0.9) - _rooms_before(ground, 0.4)[:, None]
            add(0.75 * WRONG * np.maximum(between, 0.0), f"another room comes before {name}")
    if kind in ("leave", "in") and claim.name and not said.moved:
        one = float(kind == "in")
        late = np.maximum(_rooms_before(ground, 0.9 + one) - one, 0.0)
        add(0.75 * WRONG * late, f"the path does not start in {name}")
    if kind == "stop":
        add(ramp(end - there, 0.0, 0.1), f"the path goes on from {name if claim.what else 'here'}")
        if not claim.what:
            add(ramp(went, 2.2, 3.6), "the path goes on farther than what is named before")
        elif claim.what == "thing" and not (claim.room or claim.ordinal):
            met = f"the first {claim.name} on the way is not where the path ends"
            add(_met_before(ground, said, fit), met)
    elif said.stopped and kind not in ("avoid", "walk"):
        add(ramp(end - there, 0.6, 1.2), f"{name} is not where the path ends")
    if said.is_pair and not ground.flank(said.last, claim, kind == "stop"):
        add(NEVER, f"one is not between the {said.last.name} and {name}")
    return [(np.broadcast_to(cost, (len(along),) * 2), reason) for cost, reason in parts]


def _rooms_before(ground: Ground, by_m: float) -> Costs:
    """Return (S,) how many passages lie more than `by_m` before a place."""
    at = np.array([p.along_m for p in ground.facts.passages])
    return (at[:, None] < ground.along_m - by_m).sum(axis=0).astype(np.float64)


def _beyond_first(ground: Ground, fit: Fit) -> Costs:
    """Return (S, S) what it costs to go from a place on past the first that would fit."""
    end, good = np.full(len(ground.along_m) + 1, np.inf), [*(fit.first <= _FIRST), False]
    for k in range(len(ground.along_m) - 1, -1, -1):
        end[k] = ground.along_m[k] if good[k] and not good[k + 1] else end[k + 1]
    return ramp(ground.along_m[None, :] - end[:-1, None], 2.0, 4.0)


def _met_before(ground: Ground, said: Said, fit: Fit) -> Costs:
    """Return (S, 1) what it costs that a thing to stop at is met in an earlier room."""
    told = any(c.kind == "stop" and c.what == "room" for c in said.claims)
    good = (fit.first <= _FIRST) & (ground.along_m < ground.facts.visits[-1].from_m - 1.0)
    later = np.logical_or.accumulate(good[::-1])[::-1]
    return 0.75 * WRONG * (later & (not told))[:, None]
