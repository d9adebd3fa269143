"""A vision-language model behind an OpenAI-compatible server as a policy, without any training."""

from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ....formats.core.images import data_uri, image_file
from ....formats.core.rollout import Action
from ...observation import Observation
from ...policy import Assignment
from .ask import TextModel
from .text_actions import parse_actions

PROMPT = "navigate.txt"
HISTORY = 8  # images per question, the present one among them


class VlmPolicy:
    """Shows a model evenly spaced frames of the past and asks it in words for actions.

    Actions of one answer ("move forward 75 cm") are taken one by one before the next question. An
    unclear answer is counted, and the question repeated; after the third in a row the episode is
    given up.
    """

    blind = False

    def __init__(self, model: TextModel) -> None:
        """Prepare an episode; nothing is sent yet."""
        self._model = model
        self._frames: list[str] = []
        self._waiting: deque[Action] = deque()

    @property
    def said(self) -> list[str]:
        """The model's answers that are not in the record yet."""
        return self._model.said

    @property
    def unclear(self) -> int:
        """Number of unclear answers in this episode."""
        return self._model.unclear

    def reset(self, assignment: Assignment) -> None:
        """See `Policy.reset`."""
        self._question = self._model.prompt(assignment.instruction)
        self._frames = []
        self._model.restart()
        self._waiting.clear()

    def act(self, observation: Observation) -> Action:
        """See `Policy.act`."""
        self._frames.append(_data_url(observation.rgb))
        if not self._waiting:
            self._waiting.extend(self._next_actions())
        return self._waiting.popleft()

    def _next_actions(self) -> Sequence[Action]:
        chosen = [self._frames[k] for k in evenly(len(self._frames), HISTORY)]
        images: list[dict[str, Any]] = [
            {"type": "image_url", "image_url": {"url": url}} for url in chosen
        ]
        return self._model.ask([{"type": "text", "text": self._question}, *images], parse_actions)


def evenly(count: int, most: int) -> list[int]:
    """Return at most `most` of `count` ≥ 1 positions, evenly spread, first and last among them."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist()


def _data_url(rgb: NDArray[np.uint8]) -> str:
    return data_uri(image_file(Image.fromarray(rgb), "JPEG", quality=90), "image/jpeg")
