"""The landmarks of a path: things near it, as the map and the robot's camera show them."""

import colorsys
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...formats.scene.visibility import Glimpse, PathSight
from ..language.nouns import looks_of
from .geometry import Relations, Track, relations, skin_of
from .level import LevelFacts
from .records import LandmarkFact, Moment

NEAR_M = 3.0  # a thing this near, with no wall between, is beside the path
_MIN_SIZE_M = 0.45
_BESIDE_M, _UPON_M = 0.5, 0.05
_TOP_M, _BOTTOM_M = 0.25, 1.3  # a landmark rises above the first and begins below the second
_MIN_PIXELS = 40  # of 128 × 96
_MAX_OCCLUDED = 0.8
_SIDE_RAD = np.deg2rad(20.0)
# Parts of the building, and things too flat or too common to steer by.
PLAIN = frozenset(
    """door,doorway,opening,window,curtain,curtain rod,rug,carpet,picture,lamp,ceiling lamp,
chandelier,handle,pillar,column,tableware,clock,range hood,towel rail,wall cupboard,
security camera,seasoning box,
kitchen utensils,tablet,sign""".replace("\n", "").split(",")
)


def landmarks_of(
    shared: LevelFacts, track: Track, sight: PathSight | None
) -> tuple[LandmarkFact, ...]:
    """Return the things near a path, in the order of passing.

    Args:
        track: the path, sampled.
        sight: what the camera saw along it; None = walls alone decide.
    """
    if not shared.things:
        return ()
    seen, beside = _by_thing(sight), _beside(shared)
    skin_m = np.array([skin_of(noun) for noun in shared.nouns])
    where = relations(track, shared.low_m, shared.high_m, shared.regions, skin_m)
    marks = [
        _landmark(shared, track, where, n, beside[n], seen.get(thing.name, ()), sight is not None)
        for n, thing in enumerate(shared.things)
    ]
    near = [mark for mark in marks if mark.moments]
    return _counted(sorted(near, key=lambda m: (m.along_m, m.name)))


def _landmark(
    shared: LevelFacts, track: Track, where: Relations, n: int,
    neighbour: str, glimpses: Sequence[Glimpse], looked: bool,
) -> LandmarkFact:  # fmt: skip
    thing, noun = shared.things[n], shared.nouns[n]
    floor_z_m = shared.bundle.level_floor_z_m[shared.level]
    near = (where.open[:, n] | _looked(track, glimpses)) & (where.distance_m[:, n] <= 8.0)
    # Where it is nearest in the open; behind a wall only if it is never in the open.
    distance = np.where(where.open[:, n], where.distance_m[:, n], where.distance_m[:, n] + 100.0)
    k = int(np.argmin(distance))
    bearing = float(where.bearing_rad[k, n])
    beside = _SIDE_RAD < abs(bearing) < np.pi - _SIDE_RAD
    size = np.subtract(thing.upper_m, thing.lower_m)
    low, high = thing.lower_m[2] - floor_z_m, thing.upper_m[2] - floor_z_m
    best = max(glimpses, key=lambda g: g.pixels, default=None)
    nameable = (
        noun not in PLAIN and size.max() >= _MIN_SIZE_M and high >= _TOP_M and low <= _BOTTOM_M
    )
    if looked:
        seen = best is not None and best.pixels >= _MIN_PIXELS and best.occluded <= _MAX_OCCLUDED
        nameable = nameable and seen
    pixels: dict[int, int] = {}
    for g in glimpses:
        pixels[int(np.argmin(np.abs(track.along_m - g.along_m)))] = g.pixels
    colour, material = looks_of(thing.category)
    shown = _colour_name(best.rgb) if best is not None and best.pixels >= 120 else ""
    return LandmarkFact(
        name=thing.name,
        noun=noun,
        room=shared.rooms[n],
        colour=colour or shown,
        material=material,
        nameable=bool(nameable),
        count=1,
        ordinal=1,
        along_m=round(float(track.along_m[k]), 2),
        distance_m=round(float(where.distance_m[k, n]), 2),
        side=("left" if bearing > 0 else "right") if beside else "",
        goal_distance_m=round(float(where.distance_m[-1, n]), 2),
        goal_bearing_deg=_degrees(where.bearing_rad[-1, n]),
        goal_open=bool(where.open[-1, n]),
        first_seen_m=round(min((g.along_m for g in glimpses), default=-1.0), 2),
        last_seen_m=round(max((g.along_m for g in glimpses), default=-1.0), 2),
        max_pixels=best.pixels if best else 0,
        occluded=round(best.occluded, 2) if best else 0.0,
        size_m=round(float(max(size[:2].max(), size[2])), 2),
        moments=_moments(track, where, n, np.flatnonzero(near), pixels),
        leads=shared.leads[n],
        beside=neighbour,
    )


def _beside(shared: LevelFacts) -> list[str]:
    """Return for each thing the nearest large one of another noun right beside it, "" = none."""
    low, high = shared.low_m, shared.high_m
    gap = np.maximum(low[:, None] - high[None], low[None] - high[:, None])
    upon = (gap < -_UPON_M).all(axis=-1)  # as a television stands on its stand
    gap = np.where(upon, np.inf, np.linalg.norm(gap.clip(0.0), axis=-1))
    result = []
    for n, noun in enumerate(shared.nouns):
        others = [
            (float(gap[n, k]), thing.name)
            for k, thing in enumerate(shared.things)
            if gap[n, k] <= _BESIDE_M
            and shared.nouns[k] not in (noun, *PLAIN)
            and shared.rooms[k] == shared.rooms[n]
            and np.subtract(thing.upper_m, thing.lower_m).max() >= _MIN_SIZE_M
        ]
        result.append(min(others, default=(0.0, ""))[1])
    return result


def _moments(
    track: Track, where: Relations, n: int, at: NDArray[np.intp], pixels: Mapping[int, int]
) -> tuple[Moment, ...]:
    """Return where box `n` is at some samples of the track, whose `pixels` are 0 by default."""
    metres = np.stack([track.along_m[at], where.distance_m[at, n]], axis=1)
    degrees = np.rad2deg([where.bearing_rad[at, n], where.facing_rad[at, n]]).T
    return tuple(
        Moment(round(along, 2), round(far, 2), round(a, 1), round(b, 1), clear, pixels.get(i, 0))
        for i, (along, far), (a, b), clear in zip(
            at.tolist(), metres.tolist(), degrees.tolist(), where.open[at, n].tolist(), strict=True
        )
    )


def _counted(landmarks: list[LandmarkFact]) -> tuple[LandmarkFact, ...]:
    """Count the things of each noun that are beside the path, in order."""
    beside: dict[str, list[str]] = {}
    for mark in landmarks:
        if mark.distance_m <= NEAR_M or mark.nameable:
            beside.setdefault(mark.noun, []).append(mark.name)
    return tuple(
        replace(
            mark,
            count=max(1, len(names := beside.get(mark.noun, []))),
            ordinal=names.index(mark.name) + 1 if mark.name in names else len(names) + 1,
        )
        for mark in landmarks
    )


def _by_thing(sight: PathSight | None) -> dict[str, list[Glimpse]]:
    result: dict[str, list[Glimpse]] = {}
    for glimpse in sight.glimpses if sight else ():
        if glimpse.pixels >= 8:
            result.setdefault(glimpse.thing, []).append(glimpse)
    return result


def _looked(track: Track, glimpses: Sequence[Glimpse]) -> NDArray[np.bool_]:
    mask = np.zeros(len(track.along_m), dtype=bool)
    for glimpse in glimpses:
        mask |= np.abs(track.along_m - glimpse.along_m) <= 0.26
    return mask


def _degrees(angle_rad: float) -> float:
    return round(float(np.rad2deg(angle_rad)), 1)


def _colour_name(rgb: tuple[int, int, int]) -> str:
    """Return the name of a mean sRGB colour (0–255), "" between names.

    Scans are lit warmly and unevenly: greys, whites and browns run into each other, so only
    clearly coloured and clearly dark things are named.
    """
    hue, saturation, value = colorsys.rgb_to_hsv(*(v / 255 for v in rgb))
    degrees = 360 * hue
    if value < 0.16:
        return "black"
    if saturation < 0.38 or value < 0.22:
        return ""
    for low, high, name in (
        (0, 12, "red"),
        (20, 36, "brown" if value < 0.55 else ""),
        (48, 62, "yellow" if value > 0.5 else ""),
        (85, 160, "green"),
        (200, 250, "blue"),
        (265, 300, "purple"),
        (348, 361, "red"),
    ):
        if low <= degrees < high:
            return name
    return ""
