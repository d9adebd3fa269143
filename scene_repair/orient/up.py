"""Determine which way is up: from the user, the file, or the shape of the scan."""

from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import Array
from ..config import RepairConfig, metres_per
from ..scan.record import Scan
from .gravity import (
    Surfaces,
    enclosure,
    height_range,
    level_and_upright,
    likeness,
    modes,
    refine,
    side_evidence,
)
from .scale import HIGH_ROOM_M, LOW_ROOM_M, room_height

# Rows give world x, y, z in source coordinates; each is a rotation. y up is Habitat's convention.
TO_Z_UP = {
    "z": np.eye(3),
    "-z": np.diag([1.0, -1.0, -1.0]),
    "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "-y": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "x": np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]),
    "-x": np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]]),
}
# A file's word about up is overruled only by a direction that looks like it this many times more.
OVERRULE = 4.0
# The word of a converter that keeps its source's axes counts less; and that of any file is doubted
# if walls enclose so much more of the building in another direction, which looks as likely.
OVERRULE_CONVERTER, ENCLOSED, LEAST_CLOSED = 3.0, 1.5, 0.5
# Outdoors walls enclose nothing, which must not count more than this factor.
OPEN = 0.3
# Evidence of which end is up that is weaker than this is no evidence.
FAINT = 0.1
# Another direction that far from the best is a rival if it is no less likely than by this factor.
ASLANT, NARROW_LEAD = 0.7, 2.0
# What lies nearer than this to the promised direction (cosine) is that direction.
ASIDE = 0.9
# How narrowly area must agree with a vertical to speak for it, and what a tilted one must gain.
NARROW_DEG, LEAST_GAIN = 2.0, 0.03
# Objects whose names reveal which way is up.
LOW_THINGS, HIGH_THINGS = frozenset({"floor", "rug", "carpet"}), frozenset({"ceiling", "roof"})


@dataclass(frozen=True)
class Up:
    """The up direction (3,) of a scan, the axis nearest to it, why, and doubts, one line each."""

    axis: str
    reason: str
    direction: Array
    doubts: list[str]


def find_up(scan: Scan, surfaces: Surfaces, config: RepairConfig) -> Up:
    """Return the up direction: the user's, the file's if its shape agrees, or the most likely."""
    directions = modes(surfaces)
    if config.up != "auto":
        return _promised(scan, surfaces, (config.up, "given by the user"), directions, config)
    if scan.up is not None:
        return _promised(scan, surfaces, scan.up, directions, config)
    if not len(directions):
        finding = "no direction stands out; taken as z"
        return Up("z", finding, np.array([0.0, 0.0, 1.0]), [f"up: {finding}; set --up"])
    scores = np.array(
        [likeness(surfaces, d) * max(enclosure(surfaces, d), OPEN) for d in directions]
    )
    best = directions[np.argmax(scores)]
    exact, evidence, sure = _signed(scan, surfaces, refine(surfaces, best))
    axis = _axis_of(exact)
    level, upright = level_and_upright(surfaces, exact)
    low, high = height_range(surfaces, exact)
    reason = (
        f"{100 * level:.0f} % of the area is level and {100 * upright:.0f} % upright that way, "
        f"over {high - low:.4g} units of height; {evidence}"
    )
    end = f"nothing shows which end of {axis.lstrip('-')} is up: set --up if it is upside down"
    return Up(axis, reason, exact, [*_rivals(directions, scores), *([] if sure else [end])])


def _promised(
    scan: Scan,
    surfaces: Surfaces,
    promise: tuple[str, str],
    directions: Array,
    config: RepairConfig,
) -> Up:
    """Judge an axis that the user or the file names, with the reason; users are not overruled."""
    axis, reason = promise
    direction = _near(surfaces, axis, directions, config)
    given = Up(axis, reason, direction, [])
    others = [d for d in directions if abs(float(d @ direction)) <= ASIDE]
    if not others:
        return given
    score, closed = likeness(surfaces, direction), enclosure(surfaces, direction)
    rivals = [(likeness(surfaces, d), enclosure(surfaces, d), d) for d in others]
    rival_score, rival_closed, rival = max(rivals, key=lambda r: r[0] * r[1])
    lead = rival_score / max(score, 1e-9)
    # Bare walls lying flat look like floor and ceiling; the objects between them would show it.
    bare = side_evidence(surfaces, rival)[0] == 0.0
    on_its_side = rival_closed > max(ENCLOSED * closed, LEAST_CLOSED)
    on_its_side &= lead * rival_closed > closed
    room_m, rival_room_m = np.array([room_height(surfaces, u)[1] for u in (direction, rival)]) * (
        metres_per(scan.unit[0]) if scan.unit else np.nan
    )
    usual = LOW_ROOM_M <= rival_room_m <= HIGH_ROOM_M and not LOW_ROOM_M <= room_m <= HIGH_ROOM_M
    least = OVERRULE_CONVERTER if scan.converted else OVERRULE
    # A building without floor and ceiling, seen from its side, has its walls for floors.
    stands = rival_closed >= closed / ENCLOSED
    doubtful = on_its_side or (usual and stands and lead >= 1.0 / NARROW_LEAD)
    overruled = (lead >= least and stands and not bare) or (
        doubtful and scan.converted and (on_its_side or lead >= 1.0)
    )
    exact, evidence, _ = _signed(scan, surfaces, refine(surfaces, rival))
    name = _axis_of(exact)
    if on_its_side:
        evidence = (
            f"walls enclose {100 * rival_closed:.0f} % of the ground plan with {name} up, and "
            f"{100 * closed:.0f} % with {axis} up"
        )
    elif doubtful:
        evidence = f"rooms are {rival_room_m:.2f} m high with {name} up, and {room_m:.2f} m with "
        evidence += f"{axis} up"
    if overruled and config.up == "auto":
        fit = f"{name} looks {lead:.1f} times more like it" if lead > 1 else f"{name} fits better"
        doubt = f"{name} is taken for up although {reason}: set --up {axis} if that is right"
        return Up(name, f"{reason}, but {fit}: {evidence}", exact, [doubt])
    if doubtful or (lead >= OVERRULE and stands):
        given.doubts.append(f"the building may lie on its side ({evidence}): set --up {name} if so")
    return given


def _rivals(directions: Array, scores: Array) -> list[str]:
    """Return a doubt if another direction (n, 3) is nearly as likely as the best, by score (n,)."""
    best = int(np.argmax(scores))
    aslant = np.abs(directions @ directions[best]) < ASLANT
    if not aslant.any():
        return []
    second = int(np.argmax(np.where(aslant, scores, -np.inf)))
    if scores[best] >= NARROW_LEAD * scores[second]:
        return []
    axis = _axis_of(directions[second]).lstrip("-")
    return [
        f"the file does not say what is up, and {axis} or -{axis} is nearly as likely: set --up if "
        "after.png does not look onto the floor"
    ]


def _signed(scan: Scan, surfaces: Surfaces, axis: Array) -> tuple[Array, str, bool]:
    """Return whichever of `axis` (3,) and its opposite is up, why, and whether that is sure."""
    places: dict[bool, list[float]] = {True: [], False: []}
    centers = surfaces.centers @ axis
    for thing, selected in zip(scan.objects, scan.object_faces(), strict=True):
        word = thing.category.split()[-1:]
        for low, names in ((True, LOW_THINGS), (False, HIGH_THINGS)):
            if names.intersection(word) and len(selected):
                place = np.average(centers[selected], weights=surfaces.area[selected])
                places[low].append(float(place))
    if places[True]:
        rest = places[False] or [float(np.average(centers, weights=surfaces.area))]
        sign = np.sign(float(np.mean(rest)) - float(np.mean(places[True])))
        if sign:
            return axis * sign, f"{len(places[True])} objects named as floor lie low", True
    value, evidence = side_evidence(surfaces, axis)
    sure = abs(value) >= FAINT or value == 0.0
    # Hardly any file has its building upside down.
    if value < 0 if sure and value else _axis_of(axis).startswith("-"):
        axis = -axis
        _, evidence = side_evidence(surfaces, axis)
    return axis, evidence, sure


def _axis_of(direction: Array) -> str:
    k = int(np.argmax(np.abs(direction)))
    return ("" if direction[k] > 0 else "-") + "xyz"[k]


def _near(surfaces: Surfaces, axis: str, directions: Array, config: RepairConfig) -> Array:
    """Return the vertical (3,) near a named axis: the best-scoring direction, refined."""
    given = TO_Z_UP[axis][2]
    best, most = given, 0.0
    for direction in (given, *directions):
        turned = direction * (np.sign(direction @ given) or 1.0)
        if turned @ given < np.cos(np.deg2rad(config.max_tilt_deg)):
            continue
        exact = refine(surfaces, turned)
        value = sum(level_and_upright(surfaces, exact, NARROW_DEG))
        # What is nearer to the named axis goes first, unless it explains clearly less.
        if value > most * (1.0 + LEAST_GAIN):
            best, most = exact, value
    return best
