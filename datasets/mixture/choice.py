"""The choice of a source's episodes, with the reasons why others are left out."""

import hashlib
import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...formats.core.errors import InputError, brief
from ...formats.lerobot.info import ForeignDatasetError
from ...formats.lerobot.layout import INFO_PATH
from ...formats.lerobot.splits import is_published_holdout
from ...formats.untrusted.files import is_relative
from ..episode_index import DatasetIndex, read_index
from ..selection import RECORDING, Selection, select_all
from .recipe import Recipe, Source

log = logging.getLogger(__name__)

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
_IDENTITY = (*RECORDING, "camera_width_px", "camera_height_px")
COLLECTED = ("robot", "controller", "light", "camera")  # conditions that a collection can meet
DUPLICATE, HELD_OUT, FRACTION = "duplicate", "held out", "fraction"


@dataclass(frozen=True)
class DatasetRow:
    """The episodes that a source selects from one dataset.

    Attributes:
        root: its folder.
        episodes, frames: taken.
        dropped: episodes left out, by reason.
    """

    root: Path
    robot: str
    episodes: int
    frames: int
    dropped: Mapping[str, int]


Choice = tuple[Selection, tuple[DatasetRow, ...]]  # what a source gives, and from which datasets


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
        self._read: dict[Path, DatasetIndex | ForeignDatasetError] = {}

    def find(self, patterns: Sequence[str]) -> list[DatasetIndex]:
        """Return datasets whose folders match any of the patterns, each once.

        A dataset that vlnpe did not collect is left out, with a warning, if another one matches.

        Raises:
            InputError: a pattern that is invalid, or leads out of the folder.
            NoEpisodesError: a pattern that matches no dataset.
            FileFormatError: a dataset is damaged, or vlnpe collected none that matches.
        """
        matches: dict[Path, DatasetIndex] = {}
        for pattern in patterns:
            folders = [f for f in self._folders(pattern) if (f / INFO_PATH).is_file()]
            if not folders:
                raise NoEpisodesError(f"no LeRobot dataset matches {pattern!r} in {self.root}")
            indices = {folder.resolve(): self._index(folder) for folder in folders}
            own = {k: index for k, index in indices.items() if isinstance(index, DatasetIndex)}
            if not own:
                raise next(e for e in indices.values() if isinstance(e, ForeignDatasetError))
            matches |= own
        return list(matches.values())

    def _index(self, folder: Path) -> DatasetIndex | ForeignDatasetError:
        key = folder.resolve()
        if key not in self._read:
            try:
                self._read[key] = read_index(folder)
            except ForeignDatasetError as error:
                log.warning("left out %s", error)
                self._read[key] = error
        return self._read[key]

    def _folders(self, pattern: str) -> list[Path]:
        if not is_relative(pattern):
            raise InputError(
                f"data: {brief(pattern)} leads out of {self.root}; valid: a pattern relative to it"
            )
        if Path(pattern) == Path():
            return [self.root]
        try:
            return sorted(self.root.glob(pattern))
        except (OSError, ValueError, NotImplementedError) as error:
            raise InputError(f"data: {brief(pattern)} is not a valid pattern ({error})") from error


def choose_all(
    recipe: Recipe,
    names: Iterable[str],
    library: Library,
    held_out: frozenset[str] = frozenset(),
    *,
    training: bool = False,
) -> dict[str, Choice]:
    """Return what `choose` returns of several of a recipe's sources, by name.

    Raises:
        NoEpisodesError: Sources without any episode; names them all, and what they lack.
    """
    choices: dict[str, Choice] = {}
    without: dict[str, list[str]] = {}  # what sources ask for, by the reason
    lacking: dict[str, Source] = {}
    for name in names:
        try:
            choices[name] = choose(recipe.sources[name], name, library, held_out, training=training)
        except NoEpisodesError as error:
            collected = recipe.sources[name].collected
            said = f"{collected} (source {name!r})" if collected else f"source {name!r}"
            without.setdefault(str(error), []).append(said)
            lacking |= error.lacking
    if without:
        lines = [f"{' and '.join(some)} ({why})" for why, some in without.items()]
        raise NoEpisodesError(
            f"no episodes of {'; '.join(lines)}; collect what is missing, or change the recipe",
            lacking,
        )
    return choices


def choose(
    source: Source,
    name: str,
    library: Library,
    held_out: frozenset[str] = frozenset(),
    *,
    training: bool = False,
) -> Choice:
    """Return the episodes of one source, and what is excluded from each dataset.

    A recording that lies in several datasets (a conversion, or a run that was copied) is taken
    from the first alone. For training, splits that their publisher holds out are left out unless
    the source names them.

    Raises:
        NoEpisodesError: Nothing is left; the message says why, and what the data has.
    """
    try:
        indices = library.find(source.data)
    except NoEpisodesError as error:
        raise NoEpisodesError(str(error), {name: source}) from error
    parts, rows, dropped = [], [], {}
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
            parts.append((index, np.flatnonzero(mask)))
    if not parts:
        # With other reasons, episodes of what the source asks for exist, and it can use none.
        new = all(reason.split(" ")[0] in COLLECTED for reason in dropped)
        reasons = ", ".join(f"{count} × {reason}" for reason, count in sorted(dropped.items()))
        raise NoEpisodesError(
            f"left out of {len(indices)} dataset{'s' * (len(indices) > 1)} in {library.root}: "
            f"{reasons}",
            {name: source} if new else {},
        )
    selection = Selection(
        tuple(index for index, _ in parts),
        np.repeat(np.arange(len(parts)), [len(r) for _, r in parts]).astype(np.int32),
        np.concatenate([r for _, r in parts]).astype(np.int32),
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
        conditions = getattr(source, attribute)
        if conditions:
            labels = whole.labels(label)
            name = label.removesuffix("_id").removesuffix("_name")
            why = np.array([f"{name} {value}" for value in labels], object)
            keep(np.isin(labels.astype(str), conditions), why)
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
