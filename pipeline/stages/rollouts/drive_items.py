"""Stages `drive` and `replay` of drives: their journals become episodes, and rollouts."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ....collectors.controllers import SpeedConfig
from ....collectors.driving.journal import Recording, read_journal
from ....collectors.robots import RobotSpec
from ....formats.core.atomic import file_digest
from ....formats.core.episode import Episode
from ....formats.core.errors import FileFormatError
from ....formats.core.rollout import HUMAN
from ....formats.mcap.facts import episode_from_json
from ....formats.vlnce.files import write_episodes
from ....formats.vlnce.groups import group_by_path
from ...engine.ledger import Row
from ...engine.work import ItemResult, WorkItem, work_item
from .drive_job import DriveJob
from .replay_items import STAGE as REPLAY_STAGE
from .replay_items import identity, walker
from .replay_job import Walker

STAGE = "drive"
SUFFIX = ".drive"
CONTROLLERS = {"velocity": "path", "discrete": "speed"}  # whose place the person takes
_HEADER = {"robot", "driver", "controller", "seed", "free", "episode"}
SUCCESS_M = 1.0  # a person aims at what a text names, not at a point


@dataclass(frozen=True)
class Driven:
    """A drive as its journal has it.

    Attributes:
        path: of its journal.
        episode: what was driven; of a free drive without words, and once it is kept its own way.
    """

    path: Path
    recording: Recording
    episode: Episode

    @property
    def header(self) -> Mapping[str, Any]:
        """The settings that the drive began with."""
        return self.recording.header


def folder_of(root: Path, robot: str) -> Path:
    """Return the folder of a robot's journals in a run."""
    return root / "drives" / robot


def drives_in(root: Path) -> tuple[list[Driven], dict[Path, str]]:
    """Return the drives in a run, by robot and name, and why other journals cannot be read."""
    drives, unreadable = [], {}
    for path in sorted((root / "drives").glob(f"*/*{SUFFIX}")):
        try:
            recording = read_journal(path)
            if missing := _HEADER - recording.header.keys():
                raise FileFormatError(path, f"the first line lacks {', '.join(sorted(missing))}")
            episode = episode_from_json((recording.kept or recording.header)["episode"])
        except FileFormatError as error:
            unreadable[path] = error.reason
        except (OSError, KeyError, TypeError, ValueError) as error:
            unreadable[path] = f"not a drive of this version of vlnpe: {error!r}"
        else:
            drives.append(Driven(path, recording, episode))
    return drives, unreadable


def kept_drives(root: Path) -> list[Driven]:
    """Return the drives in a run that were kept and can be read."""
    return [drive for drive in drives_in(root)[0] if drive.recording.kept is not None]


@dataclass(frozen=True)
class DrivenJob:
    """Write the episodes of the drives in one scene.

    Attributes:
        journals: of drives that were kept.
    """

    journals: tuple[Path, ...]
    out: Path

    def run(self) -> ItemResult:
        """Write the episode file."""
        episodes: dict[str, Episode] = {}
        for path in self.journals:
            kept = read_journal(path).kept
            assert kept is not None
            episode = episode_from_json(kept["episode"])
            episodes[episode.episode_id] = episode
        write_episodes(self.out, list(episodes.values()))
        return ItemResult({"episodes": len(episodes), "drives": len(self.journals)})


def episode_item(scene: Row, drives: Iterable[Driven], out: Path) -> WorkItem:
    """Write the episodes of the drives in one scene into the episode file `out`."""
    paths = tuple(drive.path for drive in drives)
    digests = {path.name: file_digest(path) for path in paths}
    return work_item(STAGE, scene.item, DrivenJob(paths, out), (out,), scene.key, journals=digests)


def drive_walker(robot: RobotSpec, header: Mapping[str, Any]) -> Walker:
    """Return how a robot is driven; a person has no limit of time, but one of 500 actions.

    A stop within `SUCCESS_M` of the goal is a success.
    """
    plain = walker(robot, header["controller"], header["seed"], SpeedConfig())
    outcome = replace(plain.config.outcome, timeout_factor=math.inf, success_m=SUCCESS_M)
    return Walker(robot, replace(plain.config, outcome=outcome))


def items(
    drives: Sequence[Driven],
    episodes: Sequence[Episode],
    scenes: Mapping[str, Row],
    scenes_folder: Path,
    rollouts: Path,
    models: Path,
    robot: RobotSpec,
) -> tuple[list[Episode], list[WorkItem]]:
    """Return the episodes that a robot was driven along, and one item for each.

    Args:
        episodes: as they are now, with instructions.
    """
    now = {episode.episode_id: episode for episode in group_by_path(episodes)}
    driven, result = [], []
    for drive in drives:
        episode = now.get(drive.episode.episode_id)
        if drive.header["robot"] != robot.name or episode is None:
            continue
        who = drive_walker(robot, drive.header)
        name = f"{robot.name}/{HUMAN}/{drive.path.name.removesuffix(SUFFIX)}"
        out = rollouts / f"{name}.mcap"
        driver = str(drive.header["driver"])
        scene = scenes_folder / episode.scene_id
        job = DriveJob(scene, episode, who, drive.path, driver, models, out)
        inputs = (episode, scenes[episode.scene_id].key, *identity(who))
        made_of = {"journal": file_digest(drive.path), "driver": driver}
        driven.append(episode)
        result.append(work_item(REPLAY_STAGE, name, job, (out,), *inputs, **made_of))
    return driven, result
