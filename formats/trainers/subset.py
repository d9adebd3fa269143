"""A subset in a layout: one robot, camera and split. Its folder, its sidecar and its README."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..core.atomic import atomic_folder
from ..core.errors import FileFormatError
from ..rendered.discrete_steps import DiscreteSteps
from .answers import Answer, Histogram, copies
from .walks import Walk, WalkSource

SIDECAR_NAME = "vlnpe_episodes.jsonl"
ANNOTATIONS_NAME = "annotations.json"


@dataclass(frozen=True)
class Subset:
    """What is written, apart from its episodes.

    Attributes:
        name: Name of the dataset, and of the split unless it is `train`.
        shares: Shares of `answers.KINDS`; empty keeps the natural ones.
        balance: What the shares are called.
        licence: Licence of the data.
        left_out: Number of episodes that are not written, by reason.
    """

    name: str
    shares: tuple[float, ...]
    balance: str
    licence: str
    left_out: Mapping[str, int]


@dataclass(frozen=True)
class Written:
    """What a writer wrote.

    Attributes:
        frames: For each episode, the source's frame numbers of its images (M,); None if its
            loaders would skip it, so that it is not written.
        records: Number of records.
        histogram: Of the records' answers; None where the layout has no answers.
        facts: Further lines for the README.
    """

    frames: Sequence[NDArray[np.int64] | None]
    records: int
    histogram: Histogram | None
    facts: tuple[str, ...] = ()


@dataclass(frozen=True)
class Layout:
    """A layout.

    Attributes:
        title: Whose it is.
        write: Write the episodes into an empty folder.
        balance: Default balance; empty where records are whole episodes, which are not repeated.
        per_scene: Whether each scene has a folder of its own, which its loaders list.
        depth: Whether it holds depth.
    """

    name: str
    title: str
    write: Callable[[Path, Sequence[WalkSource], Subset], Written]
    balance: str = ""
    per_scene: bool = False
    depth: bool = False


class Answers(Protocol):
    """A layout with one record for each answer and text of an episode."""

    turn_rad: float

    def write_pictures(self, out: Path, key: str, walk: Walk, steps: DiscreteSteps) -> None:
        """Write what the records of an episode show."""
        ...

    def answers(self, actions: NDArray[np.int64]) -> list[Answer]:
        """Return the answers along the steps of an episode."""
        ...

    def record(self, name: str, key: str, text: str, answer: Answer) -> dict[str, Any]:
        """Return a record; `name` is unique in the subset."""
        ...


def write_answers(
    layout: Answers, out: Path, sources: Sequence[WalkSource], subset: Subset
) -> Written:
    """Write a layout with one record for each answer and text; memory holds no record."""
    frames, answers = [], []
    for source in sources:
        walk = Walk.open(source)
        steps = walk.steps(layout.turn_rad)
        layout.write_pictures(out, source.key, walk, steps)
        frames.append(steps.frame)
        answers.append(layout.answers(steps.action))
    kinds = [
        answer.kind
        for source, own in zip(sources, answers, strict=True)
        for _ in source.texts
        for answer in own
    ]
    times = copies(kinds, subset.shares, np.random.default_rng(0))

    def records() -> Iterator[dict[str, Any]]:
        left = iter(times.tolist())
        for source, own in zip(sources, answers, strict=True):
            for number, text in enumerate(source.texts):
                for answer in own:
                    for copy in range(next(left)):
                        name = f"{source.key}_{number}_{answer.step}"
                        name += f"_copy{copy}" if copy else ""
                        yield layout.record(name, source.key, text, answer)

    write_array(out / ANNOTATIONS_NAME, records())
    return Written(frames, int(times.sum()), Histogram.of(kinds, times))


def write_subset(
    layout: Layout, out: Path, sources: Sequence[WalkSource], subset: Subset
) -> Written:
    """Write a subset's folder, replaced as a whole, with its sidecar and README.

    Raises:
        FileFormatError: If a unit is damaged, or no episode can be written.
    """
    with atomic_folder(out) as temporary:
        written = layout.write(temporary, sources, subset)
        pairs = [(s, f) for s, f in zip(sources, written.frames, strict=True) if f is not None]
        if not pairs:
            raise FileFormatError(out, f"no episode has as many steps as {layout.title} reads")
        write_lines(temporary / SIDECAR_NAME, (_origin(s, f) for s, f in pairs))
        (temporary / "README.md").write_text(_readme(layout, sources, subset, written))
    return written


def write_array(path: Path, values: Iterable[Mapping[str, Any]]) -> None:
    """Write a JSON array, one value a line, without holding it."""
    with path.open("w", encoding="utf-8") as stream:
        separator = "[\n"
        for value in values:
            stream.write(separator + json.dumps(value, ensure_ascii=False))
            separator = ",\n"
        stream.write("\n]\n" if separator[0] == "," else "[]\n")


def write_lines(path: Path, values: Iterable[Mapping[str, Any]]) -> None:
    """Write JSON lines."""
    with path.open("w", encoding="utf-8") as stream:
        for value in values:
            stream.write(json.dumps(value, ensure_ascii=False) + "\n")


def folder_of(path: Path) -> Path:
    """Return a folder, made if it is missing."""
    path.mkdir(parents=True, exist_ok=True)
    return path


def _origin(source: WalkSource, frames: NDArray[np.int64]) -> dict[str, Any]:
    """Return the line of the sidecar that leads an episode's records back to its source."""
    columns = Walk.open(source).unit.columns
    named = ("episode_uid", "episode_id", "trajectory_id", "scene_id", "level", "split", "robot")
    named += ("controller", "light", "camera_name", "end_reason", "start_position_world_m")
    named += ("start_yaw_world_rad", "goal_position_world_m", "instruction_episode_ids")
    return {
        "key": source.key,
        **{name: columns[name] for name in named},
        "instructions": list(source.texts),
        "source_frames": frames.tolist(),
    }


def _readme(layout: Layout, sources: Sequence[WalkSource], subset: Subset, written: Written) -> str:
    walk = Walk.open(sources[0])
    camera = walk.camera
    skipped = sum(frames is None for frames in written.frames)
    counts = {**subset.left_out, **({"too short or too long": skipped} if skipped else {})}
    left_out = ", ".join(f"{count} {reason}" for reason, count in counts.items())
    lines = [
        f"# {subset.name} in the layout of {layout.title}\n",
        "Written by `vlnpe convert`; docs/reference/layouts.md of vlnpe describes the layout.\n",
        f"- {len(sources) - skipped} episodes of the {walk.unit.robot}, {written.records} records, "
        f"{sum(len(s.texts) for s in sources)} instructions",
        f"- left out: {left_out or 'nothing'}",
        f"- camera: {camera.width_px} × {camera.height_px} px, {camera.hfov_deg:g}° horizontally, "
        f"fx = fy = {camera.focal_px:.3f}, cx = {(camera.width_px - 1) / 2:g}, "
        f"cy = {(camera.height_px - 1) / 2:g}",
        f"- licence: {subset.licence}",
        *(f"- {fact}" for fact in written.facts),
        f"- `{SIDECAR_NAME}` has a line for each episode: source, scene, robot, start, end, and "
        "the source's frame of each image; `key` is in the names of its images and records\n",
    ]
    if written.histogram:
        lines += [f"Answers, balance `{subset.balance}`:\n", *table(written.histogram), ""]
    return "\n".join(lines)


def table(histogram: Histogram) -> list[str]:
    """Return the lines of a Markdown table of the kinds of answers."""
    rows = ["| answer | before | after | share |", "| --- | ---: | ---: | ---: |"]
    total = max(sum(histogram.after.values()), 1)
    for kind, count in histogram.after.items():
        rows.append(
            f"| {kind} | {histogram.before[kind]} | {count} | {100 * count / total:.1f} % |"
        )
    return rows
