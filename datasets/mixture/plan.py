"""The plan of a mixture: datasets found, episodes selected, and why others are excluded."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...formats.core.errors import InputError, brief
from ...formats.lerobot.layout import INFO_PATH
from ...formats.lerobot.splits import is_published_holdout
from ..episode_index import DatasetIndex, read_index
from ..selection import Selection, check_frame_rate, joined_digest, select_all
from .recipe import Mixture, Recipe, Source

# Conditions in the order of their checks; an episode counts under the first that it fails.
_LABELS = {
    "robot": "robots",
    "controller": "controllers",
    "light": "lights",
    "camera_name": "cameras",
    "split": "splits",
    "scene_id": "scenes",
    "end_reason": "outcomes",
}
# What distinguishes two recordings; any two that agree in all are copies of one.
_IDENTITY = (
    "episode_uid",
    "robot",
    "controller",
    "light",
    "camera_name",
    "camera_width_px",
    "camera_height_px",
)
COLLECTED = ("robot", "controller", "light", "camera")  # conditions that a collection can meet
DUPLICATE, HELD_OUT, FRACTION = "duplicate", "held out", "fraction"


@dataclass(frozen=True)
class DatasetRow:
    """The episodes that a source selects from one dataset.

    Attributes:
        root: its folder.
        robot: whose.
        episodes, frames: taken.
        dropped: episodes left out, by reason.
    """

    root: Path
    robot: str
    episodes: int
    frames: int
    dropped: Mapping[str, int]


@dataclass(frozen=True)
class SourcePlan:
    """The episodes that a source contributes to a mixture.

    Attributes:
        name: of the source.
        weight: of the mixture.
        share: of the draws, 0 … 1.
        selection: the episodes.
        rows: by dataset.
    """

    name: str
    weight: float
    share: float
    selection: Selection
    rows: tuple[DatasetRow, ...]


@dataclass(frozen=True)
class MixturePlan:
    """The episodes and shares of a mixture.

    Attributes:
        name: of the mixture.
        sources: in the recipe's order.
        unit: what a draw is: `episodes` or `frames`.
    """

    name: str
    sources: tuple[SourcePlan, ...]
    unit: str

    @property
    def shares(self) -> NDArray[np.float64]:
        """Share of the draws of each source."""
        return np.array([source.share for source in self.sources])

    @property
    def digest(self) -> str:
        """Digest of the episodes of all sources."""
        return joined_digest(source.selection for source in self.sources)

    @property
    def sizes(self) -> list[int]:
        """Items of each source."""
        return [_size(source.selection, self.unit) for source in self.sources]


class NoEpisodesError(InputError):
    """Sources of a recipe have no episodes.

    Attributes:
        lacking: Those whose robots, controllers, lights or cameras were not collected, by name.
    """

    def __init__(self, message: str, lacking: Mapping[str, Source] | None = None):
        super().__init__(message)
        self.lacking = dict(lacking or {})


class Library:
    """The datasets under a folder, each read once."""

    def __init__(self, root: Path):
        """Look in `root`.

        Raises:
            InputError: no such folder.
        """
        if not root.is_dir():
            raise InputError(f"no such folder: {root}")
        self.root = root
        self._read: dict[Path, DatasetIndex] = {}

    def find(self, patterns: Sequence[str]) -> list[DatasetIndex]:
        """Return datasets whose folders match any of the patterns, each once.

        Raises:
            NoEpisodesError: a pattern that matches no dataset.
            FileFormatError: a dataset that vlnpe did not collect.
        """
        found: dict[Path, DatasetIndex] = {}
        for pattern in patterns:
            folders = [f for f in self._folders(pattern) if (f / INFO_PATH).is_file()]
            if not folders:
                raise NoEpisodesError(f"no LeRobot dataset matches {pattern!r} in {self.root}")
            for folder in folders:
                key = folder.resolve()
                if key not in self._read:
                    self._read[key] = read_index(folder)
                found[key] = self._read[key]
        return list(found.values())

    def _folders(self, pattern: str) -> list[Path]:
        path = Path(pattern)
        root = Path(path.anchor) if path.is_absolute() else self.root
        relative = str(path.relative_to(path.anchor))
        if relative == ".":
            return [root]
        try:
            return sorted(root.glob(relative))
        except (OSError, ValueError, NotImplementedError) as error:
            raise InputError(f"data: {brief(pattern)} is not a valid pattern ({error})") from error


def plan_mixture(
    recipe: Recipe,
    name: str,
    library: Library,
    unit: str = "episodes",
    held_out: frozenset[str] = frozenset(),
) -> MixturePlan:
    """Find a mixture's episodes.

    Args:
        recipe: names it.
        name: of the mixture.
        library: where to look.
        unit: what a draw is: `episodes` or `frames`.
        held_out: trajectories (`scene/trajectory`) that no source may take.

    Raises:
        NoEpisodesError: sources without a dataset or without any episode.
        InputError: frame rates that differ.
    """
    mixture = recipe.mixtures[name]
    found = choose_all(recipe, mixture.weights, library, held_out, training=True)
    shares = _shares(mixture, [_size(selection, unit) for selection, _ in found.values()])
    plans = tuple(
        SourcePlan(s, weight, share, *found[s])
        for (s, weight), share in zip(mixture.weights.items(), shares, strict=True)
    )
    check_frame_rate(index for plan in plans for index in plan.selection.datasets)
    return MixturePlan(name, plans, unit)


def choose_all(
    recipe: Recipe,
    names: Iterable[str],
    library: Library,
    held_out: frozenset[str] = frozenset(),
    *,
    training: bool = False,
) -> dict[str, tuple[Selection, tuple[DatasetRow, ...]]]:
    """Return what `choose` returns of several of a recipe's sources, by name.

    Raises:
        NoEpisodesError: Sources without any episode; names them all.
    """
    found, errors = {}, {}
    for name in names:
        try:
            found[name] = choose(recipe.sources[name], name, library, held_out, training=training)
        except NoEpisodesError as error:
            errors[name] = error
    if errors:
        lines = dict.fromkeys(str(error) for error in errors.values())
        lacking = {n: source for e in errors.values() for n, source in e.lacking.items()}
        raise NoEpisodesError(
            f"no episodes for {', '.join(map(repr, errors))}: {'; '.join(lines)}; collect what is "
            "missing, or change the recipe",
            lacking,
        )
    return found


def choose(
    source: Source,
    name: str,
    library: Library,
    held_out: frozenset[str] = frozenset(),
    *,
    training: bool = False,
) -> tuple[Selection, tuple[DatasetRow, ...]]:
    """Return the episodes of one source, and what is excluded from each dataset.

    A recording that lies in several datasets (a conversion, or a run that was copied) is taken
    from the first alone. For training, splits that their publisher holds out are left out unless
    the source names them.

    Raises:
        NoEpisodesError: Nothing is left; the message lists what the data has.
    """
    try:
        indices = library.find(source.data)
    except NoEpisodesError as error:
        raise NoEpisodesError(str(error), {name: source}) from error
    kept, rows, dropped = [], [], {}
    seen: set[tuple[Any, ...]] = set()
    for index in indices:
        whole = select_all([index])
        mask, reasons = _filter(source, whole, held_out, seen, training)
        dropped = {k: dropped.get(k, 0) + reasons.get(k, 0) for k in {**dropped, **reasons}}
        labels = set(whole.labels("robot"))
        rows.append(
            DatasetRow(
                index.root,
                ", ".join(sorted(labels)),
                int(mask.sum()),
                int(whole.lengths[mask].sum()),
                reasons,
            )
        )
        if mask.any():
            kept.append((index, np.flatnonzero(mask)))
    if not kept:
        # Of other reasons there are episodes of what the source asks for, and it can use none.
        new = all(reason.split(" ")[0] in COLLECTED for reason in dropped)
        raise NoEpisodesError(
            _nothing_left(name, indices, dropped, library.root), {name: source} if new else {}
        )
    selection = Selection(
        tuple(index for index, _ in kept),
        np.repeat(np.arange(len(kept)), [len(r) for _, r in kept]).astype(np.int32),
        np.concatenate([r for _, r in kept]).astype(np.int32),
    )
    return selection, tuple(rows)


def _filter(
    source: Source,
    whole: Selection,
    held_out: frozenset[str],
    seen: set[tuple[Any, ...]],
    training: bool,
) -> tuple[NDArray[np.bool_], dict[str, int]]:
    """Return which episodes to select, and why not the others; adds the selected to `seen`."""
    mask = np.ones(len(whole), bool)
    reasons: dict[str, int] = {}

    def keep(passed: NDArray[np.bool_], reasons_of: NDArray[np.object_]) -> None:
        nonlocal mask
        for reason in reasons_of[mask & ~passed]:
            reasons[reason] = reasons.get(reason, 0) + 1
        mask &= passed

    for label, attribute in _LABELS.items():
        wanted = getattr(source, attribute)
        if wanted:
            labels = whole.labels(label)
            name = label.removesuffix("_id").removesuffix("_name")
            why = np.array([f"{name} {value}" for value in labels], object)
            keep(np.isin(labels.astype(str), wanted), why)
    if training and not source.splits:
        splits = whole.labels("split")
        why = np.array([f"published hold-out {value}" for value in splits], object)
        keep(~np.array([is_published_holdout(str(s)) for s in splits], bool), why)
    new = np.ones(len(whole), bool)
    facts = list(zip(*(whole.labels(name) for name in _IDENTITY), strict=True))
    for number in np.flatnonzero(mask):
        new[number] = facts[number] not in seen
        seen.add(facts[number])
    keep(new, np.full(len(whole), DUPLICATE, object))
    trajectories = whole.trajectories()
    out = np.array([t in held_out for t in trajectories], bool)
    keep(~out, np.full(len(whole), HELD_OUT, object))
    if source.fraction < 1.0:
        drawn = np.array([_uniform(t) < source.fraction for t in trajectories], bool)
        keep(drawn, np.full(len(whole), FRACTION, object))
    return mask, reasons


def _uniform(trajectory: str) -> float:
    """Return a number in [0, 1) that depends on the name alone, not on other data."""
    digest = hashlib.blake2b(trajectory.encode(), digest_size=8).digest()
    return int.from_bytes(digest) / 2.0**64


def _shares(mixture: Mixture, sizes: Sequence[int]) -> list[float]:
    by_size = mixture.shares == "size"
    raw = [
        weight * (size if by_size else 1)
        for weight, size in zip(mixture.weights.values(), sizes, strict=True)
    ]
    return [value / sum(raw) for value in raw]


def _size(selection: Selection, unit: str) -> int:
    return len(selection) if unit == "episodes" else int(selection.lengths.sum())


def _nothing_left(
    name: str, indices: Sequence[DatasetIndex], dropped: Mapping[str, int], root: Path
) -> str:
    reasons = "; ".join(f"{count} × {reason}" for reason, count in sorted(dropped.items()))
    return f"source {name!r}: no episode is left of {len(indices)} datasets in {root} ({reasons})"
