"""Episodes of a robot's log that ROS 2 recorded, as units."""

import json
import logging
from dataclasses import asdict, dataclass
from pathlib import Path

from ....collectors.robots import get_robot
from ....formats.convert.episodes import DATASET_NAME
from ....formats.convert.facts import DatasetFacts
from ....formats.convert.ros2_unit import unit_from_log
from ....formats.core.errors import FileFormatError, InputError, UnknownNameError
from ....formats.ros2.resample import Span, spans
from ....formats.ros2.tracks import Tracks, read_tracks
from ...engine.work import ItemResult
from .jobs import Kind, Options, source_note, unit_facts

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class LogUnitJob:
    """Write the unit of one span of a log.

    Attributes:
        joint_names: The joints to keep, in order.
        out: Unit folder.
    """

    path: Path
    span: Span
    robot: str
    joint_names: tuple[str, ...]
    base_height_m: float
    options: Options
    name: str
    out: Path

    def run(self) -> ItemResult:
        """Write the unit."""
        options, assumed = self.options, self.options.assumptions
        tracks = read_tracks(self.path, options.topics)
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
            instruction=tracks.instruction or options.instruction,
        )
        parts = ("joints", "command", "imu", "depth")
        note = {
            "assumed": {
                "base_height_m": self.base_height_m,
                "end_reason": options.topics.end_reason,
            },
            "topics": asdict(options.topics),
            "missing": ["goal", "reference path", "contacts"]
            + [part for part in parts if getattr(tracks, part) is None],
            "clocks": list(tracks.doubts),
        }
        provenance = {"converted": source_note(Kind.ROS2) | note}
        facts = DatasetFacts(self.name, options.licence, provenance)
        (self.out / DATASET_NAME).write_text(json.dumps(facts.to_json()))
        return ItemResult(unit_facts(self.out, self.path))


def log_jobs(path: Path, units: Path, name: str, options: Options) -> list[LogUnitJob]:
    """Return a job for each episode of a log.

    Raises:
        InputError: If the robot is not named, or the height of its base is unknown.
        FileFormatError: If the bag is damaged or has no episode.
    """
    tracks = read_tracks(path, options.topics)
    robot, joint_names, height = _robot(path, tracks, options)
    for doubt in tracks.doubts:
        log.warning("%s: %s", path.name, doubt)
    parts = spans(tracks, options.topics)
    if not parts:
        topics = options.topics
        raise FileFormatError(
            path,
            f"no {topics.min_episode_s:g} s without a gap of {topics.max_gap_s:g} s in odometry, "
            "colour or depth",
        )
    if len(parts) > 1:
        log.warning("%s: gaps end episodes: it gives %d", path.name, len(parts))
    stem = path.stem if path.is_file() else path.name
    return [
        LogUnitJob(
            path, span, robot, joint_names, height, options, name, units / f"{stem}-{number:03d}"
        )
        for number, span in enumerate(parts)
    ]


def _robot(path: Path, tracks: Tracks, options: Options) -> tuple[str, tuple[str, ...], float]:
    """Return the robot's name, the joints to keep and the height of its base [m]."""
    named, height = options.assumptions.robot, options.assumptions.base_height_m
    if not named:
        raise InputError(f"{path}: a log does not name its robot; pass --robot")
    try:
        robot = get_robot(named)
    except UnknownNameError:
        if height is None:
            raise
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
