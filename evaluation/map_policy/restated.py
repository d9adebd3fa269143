"""Sub-goals of an instruction by a language model: it says the text again in a plain grammar."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from string import Template

from ...instruction_gen.follower.goals import SubGoal, UnfollowableError, sub_goals
from ...instruction_gen.language.parse import parse
from ...instruction_gen.llm.client import Backend, openai_backend
from ...instruction_gen.llm.settings import LlmSettings
from ..policy import PolicyError
from ..vlm import ask

PROMPT_FILE = Path(__file__).parents[1] / "prompts" / "restate.txt"
UNCLEAR = 3  # unclear answers in a row after which an episode is given up


class ModelReader:
    """Reads an instruction by a model, as `MapPolicy`'s `read`; the grammar checks its answer."""

    def __init__(
        self,
        settings: LlmSettings,
        backend: Backend | None = None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Get ready; nothing is sent yet. For the arguments see `VlmPolicy`."""
        self._settings, self._sleep = settings, sleep
        self._backend = backend or openai_backend(settings, structured=False)
        self._prompt = Template(PROMPT_FILE.read_text())

    @property
    def version(self) -> str:
        """Model and prompt, so that results of others are not taken for its own."""
        digest = hashlib.sha256(PROMPT_FILE.read_bytes()).hexdigest()[:12]
        return f"{self._settings.model} t={self._settings.temperature:g} prompt {digest}"

    def __call__(self, text: str) -> Sequence[SubGoal]:
        """Return the sub-goals of an instruction.

        Raises:
            PolicyError: If the model cannot be had, or gives no clear answer.
        """
        question = self._prompt.substitute(instruction=text)
        reason = ""
        for _ in range(UNCLEAR):
            messages = [{"role": "user", "content": question}]
            answer = ask(self._backend, self._settings, messages, self._sleep)
            read = parse(answer)
            try:
                if read.unparsed:
                    raise UnfollowableError(f"words that fit no form: {', '.join(read.unparsed)}")
                return sub_goals(read)
            except UnfollowableError as error:
                reason = f"{answer!r:.120}: {error}"
        raise PolicyError(
            f"{self._settings.model} gave {UNCLEAR} unclear answers; the last {reason}"
        )
