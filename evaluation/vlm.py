"""A vision-language model behind an OpenAI-compatible server as a policy, without any training."""

from __future__ import annotations

import base64
import hashlib
import io
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..formats.core.rollout import Action
from ..instruction_gen.llm.client import Backend, RetryableError, openai_backend
from ..instruction_gen.llm.settings import LlmSettings
from .observation import Observation
from .policy import Assignment, PolicyError
from .text_actions import parse_actions

PROMPT_FILE = Path(__file__).parent / "prompts" / "navigate.txt"
HISTORY = 8  # images per question, the present one among them
UNCLEAR = 3  # unclear answers in a row after which an episode is given up


class VlmPolicy:
    """Shows a model the past evenly, asks it in words, and takes its words at face value.

    Actions of one answer ("move forward 75 cm") are taken one by one before the next question. An
    answer that is no clear action is counted and asked again; the third in a row gives the episode
    up.

    Attributes:
        unclear: number of unclear answers in this episode.
    """

    blind = False

    def __init__(
        self,
        settings: LlmSettings,
        backend: Backend | None = None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Get ready; nothing is sent yet.

        Args:
            settings: how the model is reached.
            backend: sends one request; by default the OpenAI SDK.
            sleep: waits [s].
        """
        self._settings, self._sleep = settings, sleep
        self._backend = backend or openai_backend(settings, structured=False)
        self._prompt = Template(PROMPT_FILE.read_text())
        self._frames: list[str] = []
        self._waiting: deque[Action] = deque()
        self.unclear = 0
        self.said: list[str] = []

    @property
    def version(self) -> str:
        """Model and prompt, so that results of others are not taken for its own."""
        digest = hashlib.sha256(PROMPT_FILE.read_bytes()).hexdigest()[:12]
        return f"{self._settings.model} t={self._settings.temperature:g} prompt {digest}"

    def reset(self, assignment: Assignment) -> None:
        """See `Policy.reset`."""
        self._question = self._prompt.substitute(instruction=assignment.instruction)
        self._frames, self.unclear, self.said = [], 0, []
        self._waiting.clear()

    def act(self, observation: Observation) -> Action:
        """See `Policy.act`.

        Raises:
            PolicyError: the model cannot be had, or gives no clear answer.
        """
        self._frames.append(_data_url(observation.rgb))
        if not self._waiting:
            self._waiting.extend(self._asked())
        return self._waiting.popleft()

    def _asked(self) -> Sequence[Action]:
        chosen = [self._frames[k] for k in evenly(len(self._frames), HISTORY)]
        images: list[dict[str, Any]] = [
            {"type": "image_url", "image_url": {"url": url}} for url in chosen
        ]
        content = [{"type": "text", "text": self._question}, *images]
        reason = ""
        for _ in range(UNCLEAR):
            try:
                messages = [{"role": "user", "content": content}]
                answer = ask(self._backend, self._settings, messages, self._sleep)
                self.said.append(answer)
                return parse_actions(answer)
            except ValueError as error:
                reason, self.unclear = str(error), self.unclear + 1
        raise PolicyError(
            f"{self._settings.model} gave {UNCLEAR} unclear answers; the last {reason}"
        )


def ask(
    backend: Backend,
    settings: LlmSettings,
    messages: Sequence[dict[str, Any]],
    sleep: Callable[[float], None],
) -> str:
    """Return a model's answer, after `settings.attempts` tries at most.

    Raises:
        PolicyError: If the model cannot be had.
    """
    reason = ""
    for attempt in range(settings.attempts):
        try:
            return backend(messages).content
        except RetryableError as error:
            reason = str(error)
            wait_s = error.wait_s
            if wait_s is None:
                wait_s = settings.backoff_s * 2**attempt
            sleep(min(wait_s, settings.longest_wait_s))
    raise PolicyError(f"{settings.model}: {reason}")


def evenly(count: int, most: int) -> list[int]:
    """Return at most `most` of `count` ≥ 1 positions, evenly spread, first and last among them."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist()


def _data_url(rgb: NDArray[np.uint8]) -> str:
    stream = io.BytesIO()
    Image.fromarray(rgb).save(stream, "JPEG", quality=90)
    return "data:image/jpeg;base64," + base64.b64encode(stream.getvalue()).decode()
