"""Find up axis, unit and tilt of a scan: the transform into the world."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...formats.core.errors import SceneError
from ..config import RepairConfig, metres_per
from ..scan.record import Scan
from .bounds import robust_bounds
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
from .scale import Sizes, infer_unit, measure, room_height, sizes_in

# Rows give world x, y, z in source coordinates; each is a rotation. y up is Habitat's convention.
_TO_Z_UP = {
    "z": np.eye(3),
    "-z": np.diag([1.0, -1.0, -1.0]),
    "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "-y": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "x": np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]),
    "-x": np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]]),
}
# A building, or one room of it, measured along its longer side.
MIN_EXTENT_M, MAX_EXTENT_M = 1.0, 1000.0
# A file's word about up is overruled only by a direction that looks like it this many times more.
OVERRULE = 4.0
# The word of a converter that keeps its source's axes counts less; and that of any file is doubted
# if walls enclose so much more of the building in another direction, which looks as likely.
OVERRULE_CONVERTER, ENCLOSED, LEAST_CLOSED = 3.0, 1.5, 0.5
# Outdoors walls enclose nothing, which must not count more than this factor.
OPEN = 0.3
# Rooms are rarely lower or higher than this.
LOW_ROOM_M, HIGH_ROOM_M = 2.0, 6.0
# Evidence of which end is up that is weaker than this is no evidence.
FAINT = 0.1
# A file's word about its unit is doubted (never overruled) from this lead on.
DOUBT = 8.0
# Another direction that far from the best is a rival if it is no less likely than by this factor.
ASLANT, NARROW_LEAD = 0.7, 2.0
# What lies nearer than this to the promised direction (cosine) is that direction.
ASIDE = 0.9
# How narrowly area must agree with a vertical to speak for it, and what a tilted one must gain.
NARROW_DEG, LEAST_GAIN = 2.0, 0.03
# Objects whose names reveal which way is up.
LOW_THINGS, HIGH_THINGS = frozenset({"floor", "rug", "carpet"}), frozenset({"ceiling", "roof"})


@dataclass(frozen=True)
class Orientation:
    """The transform from source coordinates to the world.

    Attributes:
        source_to_world: (4, 4) similarity from the scan's coordinates, less its offset.
        file_to_world: (4, 4) similarity from the file's coordinates.
        habitat_to_world: (4, 4) rigid, see `SceneBundle.habitat_to_world`.
        evidence: what was decided and why, as JSON values.
    """

    source_to_world: NDArray[np.float64]
    file_to_world: NDArray[np.float64]
    habitat_to_world: NDArray[np.float64]
    evidence: dict[str, Any]


def orient(scan: Scan, config: RepairConfig) -> Orientation:
    """Determine up axis and unit from settings, file or shape, and the levelling rotation.

    Raises:
        SceneError: no unit makes the extent that of a building.
    """
    surfaces = Surfaces.of(scan.vertices, scan.faces)
    up, up_reason, vertical, up_doubts = _up(scan, surfaces, config)
    to_z_up = _TO_Z_UP[up]
    level, tilt_deg = _levelling(to_z_up @ vertical, config)
    turned = level @ to_z_up
    lower, upper = robust_bounds(scan.vertices @ turned.T, scan.faces)
    extent = upper - lower
    sizes = measure(scan, surfaces, turned)
    unit, unit_reason, unit_doubt = _unit(scan, sizes, config)
    scale = metres_per(unit)
    _check_extent(extent * scale, unit)
    source_to_world = np.eye(4)
    source_to_world[:3, :3] = scale * turned
    habitat_to_world = np.eye(4)
    habitat_to_world[:3, :3] = level @ _TO_Z_UP["y"]
    file_to_world = source_to_world.copy()
    file_to_world[:3, 3] = habitat_to_world[:3, 3] = -source_to_world[:3, :3] @ scan.offset
    return Orientation(
        source_to_world,
        file_to_world,
        habitat_to_world,
        {
            "up": up,
            "up_reason": up_reason,
            "unit": unit,
            "unit_reason": unit_reason,
            "offset": scan.offset.tolist(),
            "extent_m": [round(float(v), 4) for v in extent * scale],
            "tilt_deg": round(tilt_deg, 4),
            "levelled": bool(not np.array_equal(level, np.eye(3))),
            "room_height_m": round(sizes.room * scale, 3),
            "doubts": [*up_doubts, *unit_doubt],
        },
    )


def _up(
    scan: Scan, surfaces: Surfaces, config: RepairConfig
) -> tuple[str, str, NDArray[np.float64], list[str]]:
    """Return the axis nearest to up, the reason, the exact up direction (3,), and doubts."""
    if config.up != "auto":
        return config.up, "given by the user", _near(surfaces, config.up, config), []
    found = modes(surfaces)
    like = np.array([likeness(surfaces, m) * max(enclosure(surfaces, m), OPEN) for m in found])
    if scan.up is not None:
        axis, reason = scan.up
        promised = _near(surfaces, axis, config)
        return _promised(scan, surfaces, (axis, reason), promised, found)
    if not len(found):
        finding = "no direction stands out; taken as z"
        return "z", finding, np.array([0.0, 0.0, 1.0]), [f"up: {finding}; set --up"]
    best = found[np.argmax(like)]
    exact, evidence, sure = _signed(scan, surfaces, refine(surfaces, best))
    share, upright = level_and_upright(surfaces, exact)
    low, high = height_range(surfaces, exact)
    return (
        _axis_of(exact),
        f"{100 * share:.0f} % of the area is level and {100 * upright:.0f} % upright that way, "
        f"over {high - low:.4g} units of height; {evidence}",
        exact,
        [*_rivals(found, like), *([] if sure else [_either_end(_axis_of(exact))])],
    )


def _promised(
    scan: Scan,
    surfaces: Surfaces,
    promise: tuple[str, str],
    direction: NDArray[np.float64],
    found: NDArray[np.float64],
) -> tuple[str, str, NDArray[np.float64], list[str]]:
    """Return as `_up` does, for a file that promises an axis, `direction` (3,), with a reason."""
    axis, reason = promise
    others = [mode for mode in found if abs(float(mode @ direction)) <= ASIDE]
    if not others:
        return axis, reason, direction, []
    like, closed = likeness(surfaces, direction), enclosure(surfaces, direction)
    rivals = [(likeness(surfaces, m), enclosure(surfaces, m), m) for m in others]
    rival_like, rival_closed, best = max(rivals, key=lambda r: r[0] * r[1])
    lead = rival_like / max(like, 1e-9)
    # Bare walls lying flat look like floor and ceiling; the objects between them would show it.
    bare = side_evidence(surfaces, best)[0] == 0.0
    on_its_side = rival_closed > max(ENCLOSED * closed, LEAST_CLOSED)
    on_its_side &= lead * rival_closed > closed
    given, usual = np.array([room_height(surfaces, u)[1] for u in (direction, best)]) * (
        metres_per(scan.unit[0]) if scan.unit else np.nan
    )
    rooms = (LOW_ROOM_M <= usual <= HIGH_ROOM_M) and not LOW_ROOM_M <= given <= HIGH_ROOM_M
    least = OVERRULE_CONVERTER if scan.converted else OVERRULE
    # A building without floor and ceiling, seen from its side, has its walls for floors.
    stands = rival_closed >= closed / ENCLOSED
    doubtful = on_its_side or (rooms and stands and lead >= 1.0 / NARROW_LEAD)
    overruled = (lead >= least and stands and not bare) or (
        doubtful and scan.converted and (on_its_side or lead >= 1.0)
    )
    exact, evidence, _ = _signed(scan, surfaces, refine(surfaces, best))
    name = _axis_of(exact)
    if on_its_side:
        evidence = (
            f"walls enclose {100 * rival_closed:.0f} % of the ground plan with {name} up, and "
            f"{100 * closed:.0f} % with {axis} up"
        )
    elif doubtful:
        evidence = f"rooms are {usual:.2f} m high with {name} up, and {given:.2f} m with {axis} up"
    if overruled:
        looks = f"{name} looks {lead:.1f} times more like it" if lead > 1 else f"{name} fits better"
        return (
            name,
            f"{reason}, but {looks}: {evidence}",
            exact,
            [f"{name} is taken for up although {reason}: set --up {axis} if that is right"],
        )
    if doubtful or (lead >= OVERRULE and stands):
        return axis, reason, direction, [
            f"the building may lie on its side ({evidence}): set --up {name} if so"
        ]  # fmt: skip
    return axis, reason, direction, []


def _either_end(axis: str) -> str:
    return f"nothing shows which end of {axis.lstrip('-')} is up: set --up if it is upside down"


def _rivals(found: NDArray[np.float64], like: NDArray[np.float64]) -> list[str]:
    """Return a doubt if another direction of `found` (n, 3) is nearly as likely (n,)."""
    best = int(np.argmax(like))
    others = [k for k in range(len(found)) if abs(float(found[k] @ found[best])) < ASLANT]
    if not others:
        return []
    second = max(others, key=lambda k: like[k])
    if like[best] >= NARROW_LEAD * like[second]:
        return []
    axis = _axis_of(found[second]).lstrip("-")
    return [
        f"the file does not say what is up, and {axis} or -{axis} is nearly as likely: set --up if "
        "after.png does not look onto the floor"
    ]


def _signed(
    scan: Scan, surfaces: Surfaces, axis: NDArray[np.float64]
) -> tuple[NDArray[np.float64], str, bool]:
    """Return whichever of `axis` (3,) and its opposite is up, why, and whether that is sure."""
    places: dict[bool, list[float]] = {True: [], False: []}
    centers = surfaces.centers @ axis
    for thing, selected in zip(scan.objects, scan.object_faces(), strict=True):
        word = thing.category.split()[-1:]
        for low, names in ((True, LOW_THINGS), (False, HIGH_THINGS)):
            if names.intersection(word) and len(selected):
                places[low].append(
                    float(np.average(centers[selected], weights=surfaces.area[selected]))
                )
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


def _axis_of(direction: NDArray[np.float64]) -> str:
    k = int(np.argmax(np.abs(direction)))
    return ("" if direction[k] > 0 else "-") + "xyz"[k]


def _near(surfaces: Surfaces, axis: str, config: RepairConfig) -> NDArray[np.float64]:
    """Return the vertical (3,) near a named axis: the best-scoring direction, refined."""
    given = _TO_Z_UP[axis][2]
    best, most = given, 0.0
    for mode in (given, *modes(surfaces)):
        turned = mode * (np.sign(mode @ given) or 1.0)
        if turned @ given < np.cos(np.deg2rad(config.max_tilt_deg)):
            continue
        exact = refine(surfaces, turned)
        value = sum(level_and_upright(surfaces, exact, NARROW_DEG))
        # What is nearer to the named axis goes first, unless it explains clearly less.
        if value > most * (1.0 + LEAST_GAIN):
            best, most = exact, value
    return best


def _unit(scan: Scan, sizes: Sizes, config: RepairConfig) -> tuple[str, str, list[str]]:
    """Return the unit, the reason, and doubts about it."""
    if config.unit != "auto":
        return config.unit, "given by the user", []
    inferred, evidence, lead = infer_unit(sizes)
    if scan.unit is None:
        return inferred, evidence, []
    unit, reason = scan.unit
    if inferred == unit or lead <= DOUBT:
        return unit, reason, []
    doubt = (
        f"{sizes_in(sizes, unit)}; in {inferred} the sizes would be more usual ({evidence}): set "
        f"--unit {inferred} if that is right, or --unit to the length of the file's unit in metres"
    )
    return unit, f"{reason}, though {doubt}", [doubt]


def _check_extent(size_m: NDArray[np.float64], unit: str) -> None:
    longest = float(size_m[:2].max())
    if not MIN_EXTENT_M <= longest <= MAX_EXTENT_M:
        raise SceneError(
            f"the scene measures {_length(longest)} along its longer side (unit {unit}), which is "
            f"not a building; valid: {MIN_EXTENT_M:g} m … {MAX_EXTENT_M:g} m (set --unit if the "
            "file's unit is wrong)"
        )


def _length(metres: float) -> str:
    if metres < 1.0:
        return f"{1000 * metres:.3g} mm"
    return f"{metres:.4g} m" if metres < 1000 else f"{metres / 1000:.4g} km"


def _levelling(up: NDArray[np.float64], config: RepairConfig) -> tuple[NDArray[np.float64], float]:
    """Return the rotation from `up` (3,) to z, and its angle [deg].

    None is made for less than the tilt that is worth levelling, or for more than a scan may have
    whose up axis was given.
    """
    tilt_deg = float(np.rad2deg(np.arccos(np.clip(up[2], -1.0, 1.0))))
    named = config.up != "auto"
    if tilt_deg < config.level_tilt_deg or (named and tilt_deg > config.max_tilt_deg):
        return np.eye(3), tilt_deg
    # Shortest rotation from `up` to z (Rodrigues' formula).
    axis = np.cross(up, [0.0, 0.0, 1.0])
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + k + k @ k / (1.0 + up[2]), tilt_deg
