"""Ask a language or vision-language model in words, within limits; count unclear answers."""

import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Any

from ....instruction_gen.llm.budget import Budget
from ....instruction_gen.llm.client import Backend, RetryableError, openai_backend, wait_to_retry
from ....instruction_gen.llm.settings import LlmSettings, settings_from
from ...policy import ModelUse, PolicyError

PROMPTS = Path(__file__).parent / "prompts"
UNCLEAR = 3  # unclear answers in a row after which an episode is given up


def model_settings(policy: str, use: ModelUse) -> LlmSettings:
    """Return the settings of a policy's model from environment variables."""
    return settings_from(
        asked_by=f"--policy {policy}", max_tokens=use.max_tokens, max_cost=use.max_cost
    )


def model_version(settings: LlmSettings, prompt: bytes) -> str:
    """Return a text that identifies a model and its prompt, for reusing results."""
    digest = hashlib.sha256(prompt).hexdigest()[:12]
    return f"{settings.model} t={settings.temperature:g} prompt {digest}"


@dataclass
class TextModel:
    """A model that answers one prompt in words.

    Attributes:
        prompt_name: file of `PROMPTS`.
        budget: counts what is used, and refuses more than the limits; None = no limits.
        backend: sends one request; the OpenAI SDK when None.
        sleep: waits [s].
        unclear: number of answers so far that could not be read.
        said: the answers so far.
    """

    settings: LlmSettings
    prompt_name: str
    budget: Budget | None = None
    backend: Backend | None = None
    sleep: Callable[[float], None] = time.sleep

    def __post_init__(self) -> None:
        """Prepare the requests; nothing is sent yet."""
        self._backend = self.backend or openai_backend(self.settings, structured=False)
        self.restart()

    def restart(self) -> None:
        """Count from zero for another episode."""
        self.unclear = 0
        self.said: list[str] = []

    def prompt(self, instruction: str) -> str:
        """Return the prompt with an instruction in it."""
        text = (PROMPTS / self.prompt_name).read_text(encoding="utf-8")
        return Template(text).substitute(instruction=instruction)

    def ask[T](self, content: str | list[dict[str, Any]], read: Callable[[str], T]) -> T:
        """Return an answer as `read` parses it; ask again after an unclear one.

        Args:
            content: content of the user's message.
            read: parses an answer; raises ValueError if it is unclear.

        Raises:
            PolicyError: the model cannot be reached, or `UNCLEAR` answers in a row were unclear.
            BudgetError: no more may be spent.
            InputError: the server refuses the request for good (wrong key, unknown model, …).
        """
        reason = ""
        for _ in range(UNCLEAR):
            answer = self._answer(content)
            self.said.append(answer)
            try:
                return read(answer)
            except ValueError as error:
                reason, self.unclear = str(error), self.unclear + 1
        raise PolicyError(
            f"{self.settings.model} gave {UNCLEAR} unclear answers; the last {reason}"
        )

    def _answer(self, content: str | list[dict[str, Any]]) -> str:
        settings, reason = self.settings, ""
        for attempt in range(settings.attempts):
            if self.budget is not None:
                self.budget.check()
            try:
                reply = self._backend([{"role": "user", "content": content}])
            except RetryableError as error:
                reason = str(error)
                wait_to_retry(settings, attempt, error, self.sleep)
                continue
            if self.budget is not None:
                self.budget.add(reply.usage)
            return reply.content
        raise PolicyError(f"{settings.model}: {reason}")
