"""Sources of the labels of an image: here the renderer's ids, an oracle.

`model_labels` has those of a vision-language model.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ....instruction_gen.language.nouns import noun_of
from ...observation import Observation
from .seen_map import Detection

STRUCTURE = frozenset(("wall", "door frame", "door"))
SILENT = frozenset(("ceiling", "floor"))


class Labeller(Protocol):
    """Finds things in observations."""

    @property
    def unclear(self) -> int:
        """Number of a model's answers in this episode that could not be used."""
        ...

    @property
    def left_out(self) -> int:
        """Number of things in its other answers that have no known name, or no surface."""
        ...

    def reset(self) -> None:
        """Begin an episode."""
        ...

    def detect(self, observation: Observation) -> Sequence[Detection]:
        """Return the things in the image."""
        ...


class OracleLabeller:
    """The renderer's own labels, the same thing under the same key in every image."""

    unclear = left_out = 0

    def reset(self) -> None:
        """See `Labeller.reset`."""

    def detect(self, observation: Observation) -> Sequence[Detection]:
        """See `Labeller.detect`.

        Raises:
            ValueError: If the observation has no labels.
        """
        labels = observation.labels
        if labels is None:
            raise ValueError("the observation has no labels; valid: from a renderer with labels")
        detections = []
        for k in np.unique(labels.thing[labels.thing >= 0]).tolist():
            category = labels.categories[k]
            noun = category if category in STRUCTURE else noun_of(category)
            if noun and noun not in SILENT:
                detections.append(Detection(noun, f"{noun}-{k}", labels.thing == k))
        return detections
