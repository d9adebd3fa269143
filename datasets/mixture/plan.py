"""The plan of a mixture: what each source contributes, and its share of the draws."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..selection import Selection, check_frame_rate, joined_digest
from .choice import Choice, DatasetRow, Library, choose_all
from .recipe import Mixture, Recipe


@dataclass(frozen=True)
class SourcePlan:
    """The episodes that a source contributes to a mixture.

    Attributes:
        weight: weight in the mixture.
        share: share of the draws, 0 … 1.
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


def plan_mixture(
    recipe: Recipe,
    name: str,
    library: Library,
    unit: str = "episodes",
    held_out: frozenset[str] = frozenset(),
) -> MixturePlan:
    """Find a mixture's episodes.

    Args:
        unit: what a draw is: `episodes` or `frames`.
        held_out: trajectories (`scene/trajectory`) that no source may take.

    Raises:
        NoEpisodesError: sources without a dataset or without any episode.
        InputError: frame rates that differ.
    """
    chosen = choose_all(recipe, recipe.mixtures[name].weights, library, held_out, training=True)
    return plan_chosen(recipe, name, chosen, unit)


def plan_chosen(
    recipe: Recipe, name: str, chosen: Mapping[str, Choice], unit: str = "episodes"
) -> MixturePlan:
    """Plan a mixture of the episodes that `choose_all` chose for its sources, among others.

    Raises:
        InputError: frame rates that differ.
    """
    mixture = recipe.mixtures[name]
    shares = _shares(mixture, [_size(chosen[source][0], unit) for source in mixture.weights])
    plans = tuple(
        SourcePlan(source, weight, share, *chosen[source])
        for (source, weight), share in zip(mixture.weights.items(), shares, strict=True)
    )
    check_frame_rate(index for plan in plans for index in plan.selection.datasets)
    return MixturePlan(name, plans, unit)


def _shares(mixture: Mixture, sizes: Sequence[int]) -> list[float]:
    by_size = mixture.shares == "size"
    raw = [
        weight * (size if by_size else 1)
        for weight, size in zip(mixture.weights.values(), sizes, strict=True)
    ]
    return [value / sum(raw) for value in raw]


def _size(selection: Selection, unit: str) -> int:
    return len(selection) if unit == "episodes" else int(selection.lengths.sum())
