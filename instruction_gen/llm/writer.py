"""Texts by a model, each checked; those that fail three times are written by the composer."""

from dataclasses import replace

import numpy as np

from ..checker import Ground, check_text
from ..composer import compose_texts
from ..records import COMPOSER, InstructConfig, WrittenText
from .answers import Text
from .brief import first_messages, repair_messages
from .client import Client, ModelDownError, ModelError
from .foreign import foreign_problems

REPAIRS = 2


class ModelWriter:
    """Writes a path's texts in every language asked for.

    Attributes:
        rejected: how many texts of the model failed their check.
        replaced: how many the composer wrote instead.
    """

    def __init__(self, client: Client, config: InstructConfig):
        """Write with `client` as `config` says.

        Paths are written at the same time, so a path's texts depend on no other path's: else a
        run that goes on after a kill would ask, and pay, again.
        """
        self._client, self._config = client, config
        self.rejected = 0
        self.replaced = 0

    def __call__(
        self, ground: Ground, rng: np.random.Generator
    ) -> tuple[list[WrittenText], list[str]]:
        """Return the texts of one path.

        Raises:
            ModelDownError: the model fails again and again.
            BudgetError: no more may be spent.
        """
        written: list[WrittenText] = []
        problems: list[str] = []
        for language in self._config.languages:
            config = self._config
            styles = [config.styles[k % len(config.styles)] for k in range(config.count)]
            good = self._model_texts(ground, styles, language)
            texts = {one.text for one in (*written, *good)}
            if len(good) < config.count:
                missing = config.count - len(good)
                wanted = styles[len(good) :]
                composed, problems = compose_texts(ground, missing, wanted, rng, texts)
                self.replaced += len(composed)
                good += [
                    WrittenText(c.text, "en", c.style, COMPOSER, c.landmarks, c.attempts)
                    for c in composed
                ]
            written += good
        return written, ([] if written else problems)

    def _model_texts(self, ground: Ground, styles: list[str], language: str) -> list[WrittenText]:
        messages = first_messages(ground.facts, styles, language)
        good: list[WrittenText] = []
        for attempt in range(1 + REPAIRS):
            try:
                answer = self._client.ask(messages)
            except ModelDownError:
                raise
            except ModelError:
                return good
            failed: list[tuple[str, str, list[str]]] = []
            for text, style in zip(answer.instructions, styles[len(good) :], strict=False):
                problems = self._problems(text, language, ground, good)
                if problems:
                    self.rejected += 1
                    failed.append((style, text.text[:700], problems))
                    continue
                model = self._client.settings.model
                good.append(
                    WrittenText(text.text.strip(), language, style, "llm", (), attempt + 1, model)
                )
            if not failed or len(good) >= len(styles):
                break
            messages = repair_messages(
                first_messages(ground.facts, styles, language), failed, attempt + 1
            )
        return [replace(one) for one in good]

    def _problems(
        self, text: Text, language: str, ground: Ground, good: list[WrittenText]
    ) -> list[str]:
        words = text.text.strip()
        if any(words == one.text for one in good):
            return ["it repeats another text word for word"]
        if language == "en":
            return list(check_text(words, ground).problems)
        foreign = foreign_problems(words, language, text.english)
        return foreign or [f"its English: {p}" for p in check_text(text.english, ground).problems]
