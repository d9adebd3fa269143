"""Episodes of a robot's log that ROS 2 recorded, as units."""

import json
import logging
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from ....collectors.robots import get_robot
from ....formats.convert.episodes import DATASET_NAME, LOG_KEY
from ....formats.convert.facts import DatasetFacts
from ....formats.convert.ros2_unit import unit_from_log
from ....formats.core.errors import FileFormatError, InputError, UnknownNameError
from ....formats.ros2.log import bag_name
from ....formats.ros2.resample import Span, spans
from ....formats.ros2.topic_map import TopicMap
from ....formats.ros2.tracks import Tracks, read_tracks
from ...engine.work import ItemResult
from .jobs import Kind, Options, source_note, unit_facts

log = logging.getLogger(__name__)

Seen = tuple[tuple[str | int, ...], ...]
# A log of which episodes hold less than this share is worth a word.
_MOST = 0.95


@dataclass(frozen=True)
class LogUnitJob:
    """Write the unit of one span of a log.

    Attributes:
        seen: Sizes and times of the bag's files.
        spans_s: Where all episodes of the bag begin and end; gaps lie between them.
        joint_names: The joints to keep, in order.
        out: Unit folder.
    """

    path: Path
    seen: Seen
    span: Span
    spans_s: tuple[tuple[float, float], ...]
    robot: str
    joint_names: tuple[str, ...]
    base_height_m: float
    options: Options
    name: str
    out: Path

    @property
    def inputs(self) -> tuple[Any, ...]:
        """What decides the result."""
        return self.seen, self.span, self.joint_names, self.base_height_m

    def run(self) -> ItemResult:
        """Write the unit."""
        options, assumed = self.options, self.options.assumptions
        tracks = _tracks(self.path, options.topics, self.seen)
        unit_from_log(
            self.path,
            tracks,
            options.topics,
            self.span,
            self.out,
            robot=self.robot,
            joint_names=self.joint_names,
            base_height_m=self.base_height_m,
            rate=assumed.frames_per_second,
            split=assumed.split,
            rgb_codec=assumed.rgb_codec,
        )
        parts = ("joints", "command", "imu", "depth")
        note = {
            "assumed": {
                "base_height_m": self.base_height_m,
                "end_reason": options.topics.end_reason,
            },
            "topics": asdict(options.topics),
            "missing": ["goal", "reference path", "contacts"]
            + [part for part in parts if getattr(tracks, part) is None]
            + ([] if self.span.instruction else ["instruction"]),
            "spans_s": self.spans_s,
            "doubts": list(tracks.doubts),
        }
        provenance = {"converted": source_note(Kind.ROS2) | note}
        facts = DatasetFacts(self.name, options.licence, provenance)
        told = facts.to_json() | {LOG_KEY: bag_name(self.path)}
        (self.out / DATASET_NAME).write_text(json.dumps(told))
        spoken = {"has_text": bool(self.span.instruction)}
        return ItemResult(unit_facts(self.out, self.path) | spoken)


@dataclass(frozen=True)
class UnreadableLogJob:
    """Stands for a log, one of several, that gives no episode.

    Attributes:
        out: Where its unit would be.
    """

    path: Path
    seen: Seen
    reason: str
    out: Path

    @property
    def inputs(self) -> tuple[Any, ...]:
        """What decides the result."""
        return self.seen, self.reason

    def run(self) -> ItemResult:
        """Raise FileFormatError."""
        raise FileFormatError(self.path, self.reason)


def log_items_of(
    path: Path, seen: Seen, units: Path, name: str, options: Options, several: bool
) -> Sequence[LogUnitJob | UnreadableLogJob]:
    """Return a job for each episode of a log.

    Args:
        seen: Sizes and times of the bag's files.
        several: Whether other logs may be read although this one cannot: its job will say why.

    Raises:
        InputError: If the robot is not named, or the height of its base is unknown.
        FileFormatError: If the only bag is damaged or has no episode.
    """
    try:
        return log_jobs(path, seen, units, name, options)
    except FileFormatError as error:
        if not several:
            raise
        return [UnreadableLogJob(path, seen, error.reason, units / _episode(path, 0))]


def log_jobs(path: Path, seen: Seen, units: Path, name: str, options: Options) -> list[LogUnitJob]:
    """Return a job for each episode of a log.

    Args:
        seen: Sizes and times of the bag's files.

    Raises:
        InputError: If the robot is not named, or the height of its base is unknown.
        FileFormatError: If the bag is damaged or has no episode.
    """
    tracks = _tracks(path, options.topics, seen)
    robot, joint_names, height = _robot(path, tracks, options)
    parts = spans(path, tracks, options.topics)
    for doubt in tracks.doubts:
        log.warning("%s: %s", path.name, doubt)
    texts = dict(options.texts)
    names = [_episode(path, number) for number in range(len(parts))]
    whole_s = float(tracks.color.time_s[-1] - tracks.color.time_s[0])
    used_s = sum(part.stop_s - part.start_s for part in parts)
    if len(parts) > 1 or used_s < _MOST * whole_s:
        used = f"{len(parts)} episodes with {used_s:.1f} of {whole_s:.1f} s"
        log.warning("%s: gaps, leaps and new instructions end episodes: %s", path.name, used)
    return [
        LogUnitJob(
            path,
            seen,
            replace(
                part,
                instruction=texts.get(episode, part.instruction or options.instruction),
            ),
            tuple((each.start_s, each.stop_s) for each in parts),
            robot,
            joint_names,
            height,
            options,
            name,
            units / episode,
        )
        for episode, part in zip(names, parts, strict=True)
    ]


def check_stems(bags: Sequence[Path]) -> None:
    """Check that no two bags give their episodes the same names.

    Raises:
        InputError: If two do.
    """
    known: dict[str, Path] = {}
    for bag in bags:
        other = known.setdefault(bag_name(bag), bag)
        if other != bag:
            both = f"episodes of both would be called {bag_name(bag)}-000 and on"
            raise InputError(f"{other}, {bag}: {both}; rename one, or convert them one by one")


def _episode(path: Path, number: int) -> str:
    """Return the name of a bag's episode; it tells of one bag alone, see `check_stems`."""
    return f"{bag_name(path)}-{number:03d}"


@lru_cache(maxsize=1)
def _tracks(path: Path, topics: TopicMap, seen: Seen) -> Tracks:
    """Read a bag once for all episodes that a process makes of it; `seen` tells of changes."""
    return read_tracks(path, topics)


def _robot(path: Path, tracks: Tracks, options: Options) -> tuple[str, tuple[str, ...], float]:
    """Return the robot's name, the joints to keep and the height of its base [m]."""
    named, height = options.assumptions.robot, options.assumptions.base_height_m
    if not named:
        raise InputError(f"{path}: a log does not name its robot; pass --robot")
    try:
        robot = get_robot(named)
    except UnknownNameError as error:
        if height is None:
            raise InputError(f"{error}; any other robot's log needs --base-height-m") from error
        return named, tracks.joint_names, height
    joints = robot.joint_names
    if missing := [joint for joint in joints if joint not in tracks.joint_names]:
        if tracks.joint_names:
            log.warning(
                "%s: lacks the joint %s of %s; its own names are kept",
                path.name,
                missing[0],
                robot.name,
            )
        joints = tracks.joint_names
    return robot.name, joints, height or robot.base_height_m
