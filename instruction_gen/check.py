"""Does an instruction say what is true? Works on the text alone, whoever wrote it."""

from __future__ import annotations

import re

import numpy as np

from ..formats.core.episode import Episode
from ..formats.scene.bundle import LabeledObject, SceneBundle
from ..wayfinding.planning import resample
from ..wayfinding.regions import ROOM_OF_OBJECT, ROOM_PREFIX, RegionMap, region_map
from .actions import find_turns, route_of
from .records import Instruction

MIN_WORDS, MAX_WORDS = 8, 80
_ROOMS = ("hallway", "corridor", "office", "study", "closet", "garage", "balcony", "entrance")
_REACH_M = 3.0  # things farther from the path than this must not be named
_STOP = re.compile(r"\b(stop|wait|halt|finish|end|stand|pause)\b", re.IGNORECASE)
_SIDE = re.compile(r"\bon (?:your|the) (left|right)\b", re.IGNORECASE)
_TURN = re.compile(r"\b(left|right|around)\b", re.IGNORECASE)
_TURN_AROUND = re.compile(r"\bturn (?:all the way )?around\b(?! the)", re.IGNORECASE)
# Slight bends that a person may or may not call a turn.
_ANY_TURN_RAD = np.deg2rad(15.0)


def check_instruction(
    instruction: Instruction | str,
    episode: Episode,
    bundle: SceneBundle,
    regions: RegionMap | None = None,
) -> list[str]:
    """Problems of an instruction, one line each; empty when it is good.

    Checks its length, that it ends with where to stop, that its turns are turns of the path, in
    order, that the things and rooms it names are there along the path, and on the side it says.

    Args:
        instruction: the instruction, or its bare text.
        episode: whose path it should describe.
        bundle: the scene.
        regions: rooms of the episode's level, when they are at hand already.
    """
    text = instruction if isinstance(instruction, str) else instruction.text
    regions = regions or region_map(bundle, episode.level)
    problems = []
    words = len(text.split())
    if not MIN_WORDS <= words <= MAX_WORDS:
        problems.append(f"{words} words; valid: {MIN_WORDS} … {MAX_WORDS}")
    sentences = [s for s in re.split(r"(?<=[.!?])\s+", text.strip()) if s]
    if not sentences or not _STOP.search(sentences[-1]):
        problems.append("the last sentence does not say where to stop")
    problems += _turn_problems(text, episode)
    problems += _name_problems(text, episode, bundle, regions)
    if isinstance(instruction, Instruction):
        problems += _mention_problems(instruction, episode, bundle)
    return problems


def said_turns(text: str) -> list[str]:
    """The turns that a text asks for, in order: `left`, `right`, `around`."""
    text = _SIDE.sub(" ", text)
    found = [(m.start(), "around") for m in _TURN_AROUND.finditer(text)]
    found += [(m.start(), m[1].lower()) for m in _TURN.finditer(text) if m[1].lower() != "around"]
    return [direction for _, direction in sorted(found)]


def _turn_problems(text: str, episode: Episode) -> list[str]:
    path = episode.reference_path_world_m[:, :2]
    turns = find_turns(path, episode.start_yaw_rad, _ANY_TURN_RAD)
    left = list(turns)
    said = said_turns(text)
    for number, direction in enumerate(said, start=1):
        while left:
            turn = left.pop(0)
            back = abs(turn.angle_rad) > np.deg2rad(150)
            if direction == turn.direction or (direction == "around" and back):
                break
        else:
            real = ", ".join(f"{t.direction} {abs(np.rad2deg(t.angle_rad)):.0f}°" for t in turns)
            return [f"turn {number} ({direction}) is no turn of the path: {real or 'straight'}"]
    return []


def _name_problems(
    text: str, episode: Episode, bundle: SceneBundle, regions: RegionMap
) -> list[str]:
    """Things and rooms that the text names, but the path does not come by."""
    things: dict[str, list[LabeledObject]] = {name: [] for name in ROOM_OF_OBJECT}
    for thing in bundle.objects:
        if thing.level in (episode.level, -1) and not thing.category.startswith(ROOM_PREFIX):
            things.setdefault(thing.category.lower(), []).append(thing)
    route = route_of(episode, regions)
    visited = {c.to_room for c in route.changes} | {c.from_room for c in route.changes}
    visited |= {route.goal_room, regions.name_at(episode.start_position_world_m[:2])}
    rooms = {name.lower() for name in (*regions.names, *ROOM_OF_OBJECT.values(), *_ROOMS)} - {""}
    problems = []
    rest = text.lower()
    # Longest first, so that "kitchen table" is taken neither for a kitchen nor for a table.
    for name in sorted(things.keys() | rooms, key=len, reverse=True):
        pattern = rf"\bthe {re.escape(name)}(?:e?s)?\b"
        if not re.search(pattern, rest):
            continue
        rest = re.sub(pattern, " ", rest)
        if name in rooms and name in {v.lower() for v in visited}:
            continue
        found = things.get(name, [])
        if found:
            gap = min(_gap(thing, episode) for thing in found)
            if gap > _REACH_M:
                problems.append(f"the {name} is {gap:.1f} m from the path")
        elif name in rooms:
            problems.append(f"the path does not visit the {name}")
        else:
            problems.append(f"no {name} is labelled on this level")
    return problems


def _mention_problems(instruction: Instruction, episode: Episode, bundle: SceneBundle) -> list[str]:
    things = {o.name: o for o in bundle.objects}
    problems = []
    for mention in instruction.landmarks:
        thing = things.get(mention.name)
        if thing is None:
            problems.append(f"{mention.name} is not in the scene")
        elif (gap := _gap(thing, episode)) > _REACH_M:
            problems.append(f"{mention.name} is {gap:.1f} m from the path")
        elif mention.side and _side(thing, episode) != mention.side:
            problems.append(f"{mention.name} is not on the {mention.side}")
        stem = mention.category.lower().split()[-1][:4]
        if stem not in instruction.text.lower():
            problems.append(f"{mention.category} is listed but not in the text")
    return problems


def _nearest(thing: LabeledObject, episode: Episode) -> tuple[float, int]:
    points = _dense(episode)
    low, high = np.array(thing.lower_m[:2]), np.array(thing.upper_m[:2])
    gaps = np.linalg.norm(points - np.clip(points, low, high), axis=1)
    return float(gaps.min()), int(np.argmin(gaps))


def _gap(thing: LabeledObject, episode: Episode) -> float:
    return _nearest(thing, episode)[0]


def _side(thing: LabeledObject, episode: Episode) -> str:
    """Side of the path on which a thing lies where it is nearest."""
    points = _dense(episode)
    k = _nearest(thing, episode)[1]
    forward = points[min(k + 2, len(points) - 1)] - points[max(k - 2, 0)]
    low, high = np.array(thing.lower_m[:2]), np.array(thing.upper_m[:2])
    to = np.clip(points[k], low, high) - points[k]
    return "left" if forward[0] * to[1] - forward[1] * to[0] > 0 else "right"


def _dense(episode: Episode) -> np.ndarray:
    return resample(episode.reference_path_world_m[:, :2], 0.2)
