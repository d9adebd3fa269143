"""Texts by a model, each checked; those that fail three times are written by the composer."""

import numpy as np

from ...formats.core.errors import InputError
from ..checker import Ground, Verdict, check_text
from ..checker.form import script_problems
from ..composer import compose_texts
from ..records import InstructConfig, WrittenText
from ..rivals import Rivals
from .answers import Text
from .brief import back_messages, first_messages, repair_messages
from .client import Client, ModelDownError, ModelError

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
        self, ground: Ground, rng: np.random.Generator, rivals: Rivals | None = None
    ) -> tuple[list[WrittenText], list[str]]:
        """Return the texts of one path; those of the composer lead to none of its `rivals`.

        Raises:
            ModelDownError: the model fails again and again.
            BudgetError: no more may be spent.
        """
        written: list[WrittenText] = []
        problems: list[str] = []
        for language in self._config.languages:
            config = self._config
            styles = [config.styles[k % len(config.styles)] for k in range(config.count)]
            good, missing, error = self._model_texts(ground, styles, language)
            if error and not good:
                return [], [error]  # the composer's texts in its place would pass unnoticed
            if language != "en" and not good:
                return [], [f"no text in the language {language} passed its check"]
            texts = {one.text for one in (*written, *good)}
            if missing and language == "en":
                composed, problems = compose_texts(
                    ground, len(missing), missing, rng, texts, rivals=rivals
                )
                self.replaced += len(composed)
                good += composed
            written += good
        return written, ([] if written else problems)

    def _model_texts(
        self, ground: Ground, styles: list[str], language: str
    ) -> tuple[list[WrittenText], list[str], str]:
        """Return the model's true texts, the styles in which it wrote none, and its last error."""
        messages = first = first_messages(ground.facts, styles, language)
        good: list[WrittenText] = []
        missing, reason = styles, ""
        for attempt in range(1 + REPAIRS):
            try:
                answer = self._client.ask(messages)
            except ModelDownError:
                raise
            except ModelError as error:
                reason = str(error)
                break
            failed: list[tuple[str, str, list[str]]] = []
            for text, style in zip(answer.instructions, missing, strict=False):
                words = text.words
                verdict = self._verdict(text, language, ground, good)
                problems = list(verdict.problems)
                if verdict.unchecked and attempt < REPAIRS:
                    problems.append(f"no claim covers: {', '.join(verdict.unchecked)}")
                if problems:
                    self.rejected += 1
                    failed.append((style, words[:700], problems))
                    continue
                model = self._client.settings.model
                # Claims that were only read are read again by whoever needs them.
                steps = verdict.steps if text.steps or language != "en" else ()
                good.append(
                    WrittenText(words, language, style, "llm", (), attempt + 1, model,
                                steps, verdict.unchecked)
                )  # fmt: skip
            # Those that are asked for again come first: answers have the order of the request.
            missing = [style for style, _, _ in failed] + missing[len(answer.instructions) :]
            if not failed:
                break
            messages = repair_messages(first, failed, attempt + 1)
        return good, missing, reason

    def _verdict(
        self, text: Text, language: str, ground: Ground, good: list[WrittenText]
    ) -> Verdict:
        words = text.words
        if any(words == one.text for one in good):
            return Verdict(("it repeats another text word for word",))
        if language != "en":
            return self._translated(words, language, ground)
        try:
            return check_text(words, ground, text.claimed())
        except InputError as error:
            return Verdict((str(error),))

    def _translated(self, text: str, language: str, ground: Ground) -> Verdict:
        """Check a text by its translation into English, which becomes the steps of the verdict.

        The model is asked without the facts, so that it cannot translate what should be there. If
        it gives no usable translation, the whole text is unchecked.
        """
        if problems := script_problems(text, language):
            return Verdict(tuple(problems))
        try:
            back = self._client.ask(back_messages(text)).instructions[0]
            steps = back.claimed()
        except ModelDownError:
            raise
        except (ModelError, InputError):
            return Verdict((), unchecked=(text,))
        verdict = check_text(back.words, ground, steps)
        said = tuple(f"translated back: {problem}" for problem in verdict.problems)
        return Verdict(said, (), verdict.unchecked, verdict.steps)
