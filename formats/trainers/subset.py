"""A subset in a layout: one robot, camera and split. Its folder, its sidecar and its README."""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..core.atomic import atomic_folder
from ..core.errors import FileFormatError
from ..rendered.discrete_steps import DiscreteSteps
from .answers import KINDS, Answer, copies, parse_balance
from .walks import Walk, WalkSource

SIDECAR_NAME = "vlnpe_episodes.jsonl"
ANNOTATIONS_NAME = "annotations.json"


@dataclass(frozen=True)
class Subset:
    """What is written, apart from its episodes.

    Attributes:
        name: `<split>/<dataset>`.
        balance: What `parse_balance` takes.
        licence: Licence of the data.
        left_out: Number of episodes that are not written, by reason.
    """

    name: str
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
        before, after: Number of answers of each kind before and after balancing; empty where the
            layout has no answers.
        facts: Further lines for the README.
    """

    frames: Sequence[NDArray[np.int64] | None]
    records: int
    before: Mapping[str, int]
    after: Mapping[str, int]
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
        labels: Whether it takes walks of DAgger, whose actions do not lead to the next frame.
        endings: Whether it says how each episode ended, so that failures can be written.
        rigs: Whether it holds views of several rigs in one tree.
    """

    name: str
    title: str
    write: Callable[[Path, Sequence[WalkSource], Subset], Written]
    balance: str = ""
    per_scene: bool = False
    depth: bool = False
    labels: bool = False
    endings: bool = False
    rigs: bool = False


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
    times = copies(kinds, parse_balance(subset.balance), np.random.default_rng(0))

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
    after = Counter(np.repeat(np.array(kinds, dtype=object), times).tolist())
    return Written(frames, int(times.sum()), Counter(kinds), after)


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
        for number, value in enumerate(values):
            stream.write((",\n" if number else "[\n") + json.dumps(value, ensure_ascii=False))
        stream.write("\n]\n")


def write_lines(path: Path, values: Iterable[Mapping[str, Any]]) -> None:
    """Write JSON lines."""
    with path.open("w", encoding="utf-8") as stream:
        stream.writelines(json.dumps(value, ensure_ascii=False) + "\n" for value in values)


def folder_of(path: Path) -> Path:
    """Return a folder, made if it is missing."""
    path.mkdir(parents=True, exist_ok=True)
    return path


def _origin(source: WalkSource, frames: NDArray[np.int64]) -> dict[str, Any]:
    """Return the line of the sidecar that leads an episode's records back to its source."""
    views = [walk.unit.columns for walk in Walk.open_all(source)]
    columns = {**views[0], "camera_name": ",".join(view["camera_name"] for view in views)}
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
    if written.before:
        counts = table(written.before, written.after)
        lines += [f"Answers, balance `{subset.balance}`:\n", *counts, ""]
    return "\n".join(lines)


def table(before: Mapping[str, int], after: Mapping[str, int]) -> list[str]:
    """Return the lines of a Markdown table of the kinds of answers."""
    rows = ["| answer | before | after | share |", "| --- | ---: | ---: | ---: |"]
    for kind in filter(after.get, KINDS):
        share = 100 * after[kind] / sum(after.values())
        rows.append(f"| {kind} | {before[kind]} | {after[kind]} | {share:.1f} % |")
    return rows
