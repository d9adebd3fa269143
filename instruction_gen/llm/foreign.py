"""Texts in other languages than English: a model translates them back, and that is checked.

It is asked without the facts, so that it cannot translate what should be there.
"""

from ...formats.core.errors import InputError
from ..checker import Ground, Verdict, check_text
from ..checker.form import script_problems
from .brief import back_messages
from .client import Client, ModelDownError, ModelError


def check_translation(client: Client, text: str, language: str, ground: Ground) -> Verdict:
    """Check a text by its translation into English, which becomes the steps of the verdict.

    If the model gives no usable translation, the whole text is unchecked.

    Raises:
        ModelDownError: the model fails again and again.
        BudgetError: no more may be spent.
    """
    if problems := script_problems(text, language):
        return Verdict(tuple(problems))
    try:
        back = client.ask(back_messages(text)).instructions[0]
        steps = back.claimed()
    except ModelDownError:
        raise
    except (ModelError, InputError):
        return Verdict((), unchecked=(text,))
    verdict = check_text(back.words, ground, steps)
    said = tuple(f"translated back: {problem}" for problem in verdict.problems)
    return Verdict(said, (), verdict.unchecked, verdict.steps)
