"""Whether a row's agents fit the episodes that they were trained on."""

from dataclasses import dataclass

from .evaluate import Summary
from .intervals import Estimate, over_seeds
from .run import Row

REST = 0.5  # of the errors of the commonest action that an agent that fits may still make


@dataclass(frozen=True)
class Fit:
    """How well a row's agents predict some of their own training episodes.

    It depends on the row alone, not on what the row is tested on, so a row has one verdict.

    Attributes:
        action: part of the training steps whose action is predicted, over seeds.
        constant: part that the commonest action of each source gets right on the same steps.
    """

    action: Estimate
    constant: float

    @property
    def fits(self) -> bool:
        """Whether at most half of the errors of the commonest action are left."""
        return 1 - self.action.mean <= REST * (1 - self.constant)


def training_fit(row: Row) -> Fit:
    """Return how well a row fits its training episodes."""
    reached = over_seeds([Summary.of(run).action for run in row.training])
    return Fit(reached, Summary.of(row.training_constant).action)
