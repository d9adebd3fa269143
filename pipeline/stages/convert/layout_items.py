"""Stages named like the layouts of trainers: units to `<layout>/<split>/<dataset>/`."""

import logging
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ....formats.convert.episodes import joint_facts
from ....formats.core.errors import InputError
from ....formats.core.rollout import DAGGER, EndReason
from ....formats.internnav.layout import scene_name
from ....formats.internnav.writer import share_instructions
from ....formats.lerobot import read_episode_unit
from ....formats.lerobot.layout import DEPTH_KEY
from ....formats.lerobot.splits import TRAIN, published_split
from ....formats.lerobot.units.unit import EpisodeUnit
from ....formats.trainers.answers import parse_balance
from ....formats.trainers.registry import LAYOUTS
from ....formats.trainers.subset import Layout, Subset
from ....formats.trainers.walks import WalkSource
from ....rendering.camera.rigs import without_rig
from ...engine.ledger import Row
from ...engine.work import WorkItem, work_item
from .layout_job import LayoutJob

log = logging.getLogger(__name__)

SLOWEST_RATE = 4  # frames/s; at fewer a robot makes several steps from one frame to the next
SEEN_SPLIT = "val_seen"  # published with other paths of the scenes that train


@dataclass(frozen=True)
class Choice:
    """What a user chooses of a layout.

    Attributes:
        balance: What `parse_balance` takes, for training only; empty for the layout's own.
        keep_failures: Whether to write episodes that failed.
    """

    balance: str = ""
    keep_failures: bool = False


def check_choice(name: str, choice: Choice) -> None:
    """Check a choice for the format or layout `name`.

    Raises:
        InputError: If there is no such balance, the layout's records cannot be repeated, or it
            does not say how an episode ended.
    """
    layout, balance = LAYOUTS.get(name), choice.balance
    if balance and parse_balance(balance) and not (layout and layout.balance):
        balanced = ", ".join(other.name for other in LAYOUTS.values() if other.balance)
        raise InputError(
            f"--balance {balance}: records of {name} are whole episodes, which are not repeated; "
            f"valid: natural, or one of the layouts {balanced}"
        )
    if choice.keep_failures and not (layout and layout.endings):
        valid = ", ".join(other.name for other in LAYOUTS.values() if other.endings)
        raise InputError(
            f"--keep-failures: {name} has no field for how an episode ended; valid: {valid}"
        )


def layout_items(
    name: str,
    rows: Mapping[str, Row],
    root: Path,
    dataset: str,
    choice: Choice = Choice(),
    *,
    held_out: Collection[str] = (),
    licence: str | None = None,
) -> list[WorkItem]:
    """Return the items that write the episodes of a dataset, or of a group, in a layout.

    Args:
        name: Key of `LAYOUTS`.
        rows: Of stages that write units, by item; of several datasets if they differ in the rig.
        root: The ledger's folder; output goes to `<root>/<name>/<split>/<dataset>/`.
        choice: What `check_choice` takes.
        held_out: Scenes whose training episodes validate, if the units do not know yet.
        licence: Licence of the data; None takes what the units say.

    Raises:
        InputError: If a path is in two splits, or a scene trains and validates.
    """
    layout = LAYOUTS[name]
    walks, cameras = _walks(rows, root)
    left_out: dict[tuple[str, str], Counter[str]] = {}
    good: list[tuple[tuple[str, str], tuple[str, ...], list[EpisodeUnit]]] = []
    for keys, views in walks:
        columns = views[0].columns
        split = published_split(columns["split"], columns["scene_id"], held_out)
        level = f"-level{columns['level']}" if columns["level"] else ""
        group = (split, _file_name(columns["scene_id"]) + level if layout.per_scene else "")
        missing = f"without all {cameras} rigs" if len(views) < cameras else ""
        if reason := missing or _why_left_out(views[0], layout, choice):
            left_out.setdefault(group, Counter())[reason] += 1
        else:
            good.append((group, keys, views))
    if not good:
        counts = ", ".join(f"{n} {why}" for c in left_out.values() for why, n in c.items())
        log.warning("%s: no episode to write as %s; left out: %s", dataset, name, counts)
        return []
    first = [views[0] for *_, views in good]
    _check_splits([(group[0], unit.columns) for (group, *_), unit in zip(good, first, strict=True)])
    if licence is None:
        licence = joint_facts([unit.folder for unit in first], dataset, "unknown", None).licence
    members: dict[tuple[str, str], list[tuple[tuple[str, ...], WalkSource]]] = {}
    texts = share_instructions(first)
    for number, ((group, keys, views), own) in enumerate(zip(good, texts, strict=True)):
        folder, *others = (view.folder for view in views)
        prefix = f"{_file_name(views[0].columns['scene_id'])}_{_file_name(views[0].robot)}"
        source = WalkSource(folder, f"{prefix}_{number:06d}", own, tuple(others))
        members.setdefault(group, []).append((keys, source))
    result = []
    for (split, scene), chosen in members.items():
        named = f"{split}/{dataset}"  # NavDP's loader reads all that lies in one folder
        used = (choice.balance or layout.balance if split == TRAIN else "") or "natural"
        dropped = left_out.get((split, scene), {})
        subset = Subset(named, used, licence, dropped)
        out = root / name / named / scene if scene else root / name / named
        job = LayoutJob(name, tuple(source for _, source in chosen), subset, out)
        inputs = ([(keys, source.key, source.texts) for keys, source in chosen], subset)
        item = f"{dataset}/{split}/{scene}".rstrip("/")
        result.append(work_item(name, item, job, (out,), *inputs))
    return result


def group_name(name: str, dataset: str) -> str:
    """Return the name under which the layout `name` has a dataset: its own, or without its rig."""
    return without_rig(dataset) if LAYOUTS[name].rigs else dataset


def _walks(
    rows: Mapping[str, Row], root: Path
) -> tuple[list[tuple[tuple[str, ...], list[EpisodeUnit]]], int]:
    """Return keys and views of each walk, sorted by camera, and how many cameras there are."""
    counts: Counter[tuple[str, str, str]] = Counter()
    walks: dict[tuple[str, str, int], list[tuple[str, str, EpisodeUnit]]] = {}
    for row in rows.values():
        unit = replace(read_episode_unit(root / row.outputs[0]), statistics={}, features={})
        path, camera = (unit.columns["episode_uid"], unit.task), unit.columns["camera_name"]
        counts[*path, camera] += 1  # a dataset may hold an episode twice
        walks.setdefault((*path, counts[*path, camera]), []).append((camera, row.key, unit))
    result = []
    for views in walks.values():
        views.sort(key=lambda view: view[0])
        result.append((tuple(key for _, key, _ in views), [unit for *_, unit in views]))
    return result, len({camera for *_, camera in counts})


def _check_splits(episodes: Sequence[tuple[str, Mapping[str, Any]]]) -> None:
    """Check splits and columns of episodes; `val_seen` has scenes of `train` by definition."""
    trained = {columns["scene_id"] for split, columns in episodes if split == TRAIN}
    splits: dict[tuple[str, str], str] = {}
    for split, columns in episodes:
        scene, path = columns["scene_id"], columns["trajectory_id"]
        other = splits.setdefault((scene, path), split)
        if other == split and split not in (TRAIN, SEEN_SPLIT) and scene in trained:
            other = TRAIN
        if other != split:
            raise InputError(
                f"scene {scene}, path {path} is in the splits {other} and {split}; valid: one "
                "split per path and scene"
            )


def check_source(name: str, dataset: str, unit: EpisodeUnit) -> None:
    """Check that a dataset has what the format or layout `name` needs.

    Raises:
        InputError: If it lacks depth or frames; the message names the command that adds them.
    """
    if DEPTH_KEY not in unit.features and (name not in LAYOUTS or LAYOUTS[name].depth):
        raise InputError(
            f"{dataset} lacks {DEPTH_KEY}, which {name} needs; `vlnpe export RUN` writes it"
        )
    if name in LAYOUTS and unit.frames_per_second < SLOWEST_RATE:
        raise InputError(
            f"{dataset} has {unit.frames_per_second} frames/s, too few for steps of 0.25 m; "
            f"`vlnpe collect … --frames-per-second {SLOWEST_RATE}` renders more"
        )


def _why_left_out(unit: EpisodeUnit, layout: Layout, choice: Choice) -> str:
    reason = unit.columns["end_reason"]
    if reason != EndReason.SUCCESS and not choice.keep_failures:
        return str(reason)
    if unit.columns["controller"] == DAGGER and not layout.labels:
        valid = ", ".join(name for name, other in LAYOUTS.items() if other.labels)
        return f"of dagger (valid: {valid})"
    return "" if unit.task.strip() else "without an instruction"


def _file_name(name: str) -> str:
    """Return a robot's name, or the last part of a scene's id, as files of a layout have it."""
    return re.sub(r"[^A-Za-z0-9-]+", "-", scene_name(name)).strip("-") or "scene"
