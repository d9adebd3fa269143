"""Sub-goals of an instruction by a language model, which rewords the text in a plain grammar."""

from collections.abc import Sequence

from ....instruction_gen.language.reader import read_text
from ..follower.goals import Part, UnfollowableError, parts_of
from ..llm.ask import TextModel

PROMPT = "restate.txt"


class ModelReader:
    """Reads an instruction by a model, as `MapPolicy`'s `read`; the grammar checks its answer."""

    def __init__(self, model: TextModel) -> None:
        """Get ready; nothing is sent yet."""
        self._model = model

    @property
    def unclear(self) -> int:
        """Number of unclear answers to the last instruction."""
        return self._model.unclear

    @property
    def said(self) -> list[str]:
        """The answers to the last instruction."""
        return self._model.said

    def __call__(self, text: str) -> Sequence[Part]:
        """Return the parts of an instruction."""
        self._model.restart()
        return self._model.ask(self._model.prompt(text), _parts)


def _parts(answer: str) -> Sequence[Part]:
    steps = read_text(answer)
    try:
        if odd := [word for step in steps for word in (*step.unchecked, *step.faults)]:
            raise UnfollowableError(f"words that fit no form: {', '.join(odd)}")
        return parts_of(steps)
    except UnfollowableError as error:
        raise ValueError(f"{answer!r:.120}: {error}") from error
