"""Settings of the instructions, and the record that is kept of each text."""

from dataclasses import dataclass
from typing import Any

from ..formats.core.errors import InputError, UnknownNameError
from .language.claims import Step, step_record
from .llm.settings import LlmSettings

STYLES = ("natural", "terse", "rich")
COMPOSER, LLM, LOCAL = "composer", "llm", "local"
WRITERS = (COMPOSER, LLM, LOCAL)
LANGUAGES = ("en", "hi", "zh")
MIXED = "mixed"
MOST = 12


@dataclass(frozen=True)
class InstructConfig:
    """How instructions are made.

    Attributes:
        writer: one of `WRITERS`.
        styles: of `STYLES`, taken in turn for the texts of a path.
        count: texts per path and language.
        languages: of `LANGUAGES`; the composer writes English only.
        replace: also rewrite instructions that are there already.
        llm: where the model is; only for writers that ask one.
    """

    writer: str = COMPOSER
    styles: tuple[str, ...] = STYLES
    count: int = 3
    languages: tuple[str, ...] = ("en",)
    replace: bool = False
    llm: LlmSettings | None = None

    def __post_init__(self):
        if self.writer not in WRITERS:
            raise UnknownNameError("instruction writer", self.writer, WRITERS)
        if not 1 <= self.count <= MOST:
            raise InputError(f"--count {self.count}; valid: 1 … {MOST}")
        for style in self.styles:
            if style not in STYLES:
                raise UnknownNameError("instruction style", style, (*STYLES, MIXED))
        for language in self.languages:
            if language not in LANGUAGES:
                raise UnknownNameError("language", language, LANGUAGES)
        if not self.styles or not self.languages:
            raise InputError("--style and --language need at least one name each")
        if self.writer == COMPOSER and self.languages != ("en",):
            raise InputError(
                f"the composer writes English only, not {','.join(self.languages)}; "
                "other languages need --writer llm"
            )


def parse_styles(text: str) -> tuple[str, ...]:
    """Return `mixed` → all styles in turn; else names separated by commas."""
    return STYLES if text == MIXED else tuple(w.strip() for w in text.split(",") if w.strip())


def parse_languages(text: str) -> tuple[str, ...]:
    """Return the names separated by commas, each once."""
    return tuple(dict.fromkeys(w.strip() for w in text.split(",") if w.strip()))


@dataclass(frozen=True)
class WrittenText:
    """One text of a path.

    Attributes:
        language: of `LANGUAGES`.
        style: of `STYLES`.
        writer: who wrote it in the end: a text of a model that fails is the composer's.
        landmarks: names of the scene's objects it speaks of, where the writer says so.
        attempts: drafts it took.
        model: of a language model, "" otherwise.
        steps: it says, with their claims; of a text in another language those of its translation.
        from_m: how far along the path each step begins; only of texts whose words the steps are.
        leads_elsewhere: where else it leads; kept only where the scan has no names to tell it by.
        unchecked: words that no claim covers: such a text is exported if a person vouches for it.
    """

    text: str
    language: str
    style: str
    writer: str
    landmarks: tuple[str, ...] = ()
    attempts: int = 1
    model: str = ""
    steps: tuple[Step, ...] = ()
    unchecked: tuple[str, ...] = ()
    from_m: tuple[float, ...] = ()
    leads_elsewhere: str = ""

    def record(self) -> dict[str, Any]:
        """Return it as JSON."""
        open_ = {"unchecked": list(self.unchecked)} if self.unchecked else {}
        return {
            "text": self.text,
            "language": self.language,
            "style": self.style,
            "writer": self.writer,
            "landmarks": list(self.landmarks),
            "attempts": self.attempts,
            "model": self.model,
            "claims": [step_record(step) for step in self.steps],
            **({"from_m": list(self.from_m)} if self.from_m else {}),
            **open_,
            **({"leads_elsewhere": self.leads_elsewhere} if self.leads_elsewhere else {}),
        }
