"""What it costs to place a claim along a path: 0 where anybody would say it, 1 where hardly any."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Costs = NDArray[np.floating[Any]]
Mask = NDArray[np.bool_]
Part = tuple[Costs | float, str]  # (N, S) or what broadcasts to it, and what is wrong

NEVER, WRONG = 9.0, 2.0  # what cannot be, and what is plainly another


def ramp(value: Costs | float, free: float, dear: float) -> Costs:
    """Return 0 up to `free`, 1 at `dear`, and on in a straight line to `NEVER`."""
    return np.clip((np.asarray(value, dtype=np.float64) - free) / (dear - free), 0.0, NEVER)


@dataclass(frozen=True)
class Fit:
    """What it costs to place a claim at each of S places.

    Attributes:
        parts: (P, S), the largest counts.
        reasons: what is wrong where a part is large.
        first: (S,) the cost without sides: what is met first is meant.
    """

    parts: Costs
    reasons: tuple[str, ...]
    first: Costs

    @property
    def cost(self) -> Costs:
        """(S,) of the worst part."""
        return self.parts.max(axis=0)

    def reason(self, place: int) -> str:
        """Return what is wrong at a place."""
        return self.reasons[int(self.parts[:, place].argmax())]


def never(places: int, reason: str) -> Fit:
    """Return the fit of what holds nowhere."""
    return best((1, places), [(NEVER, reason)])


def best(shape: tuple[int, ...], told: Sequence[Part], sides: Sequence[Part] = ()) -> Fit:
    """Return the fit of the best of N candidates at each of S places, `shape` (N, S).

    Args:
        told: what it costs to mean a candidate.
        sides: where it is, which does not tell candidates apart.
    """
    every = (*told, *sides)
    parts = np.stack([np.broadcast_to(cost, shape) for cost, _ in every])
    own = parts.max(axis=0).argmin(axis=0)
    first = parts[: len(told)].max(axis=0).min(axis=0)
    return Fit(parts[:, own, np.arange(shape[1])], tuple(reason for _, reason in every), first)
