"""The state of a reader: the tokens of a text, and the clause that is being read."""

from dataclasses import dataclass, field

from .clauses import Clause, Noun
from .idioms import plainer
from .tokens import Token, tokenize


@dataclass
class Draft:
    """A clause that is being read; see `Clause` for the fields.

    Attributes:
        pending_side: a side that belongs to the next noun, "" = none.
    """

    start: int
    stop: int = 0
    verb: str = ""
    side: str = ""
    degree: str = ""
    nouns: list[Noun] = field(default_factory=list)
    distance_m: float = 0.0
    vague: bool = False
    negated: bool = False
    there: bool = False
    until: bool = False
    before: bool = False
    meanwhile: bool = False
    unparsed: int = 0
    pending_side: str = ""

    @property
    def empty(self) -> bool:
        """Whether nothing has been read yet."""
        return not (self.verb or self.side or self.nouns or self.distance_m or self.there)

    def done(self) -> Clause:
        """Return the clause."""
        return Clause(
            self.start, self.stop, self.verb, self.side, self.degree, tuple(self.nouns),
            self.distance_m, self.vague, self.negated, self.there, self.until, self.before,
            self.meanwhile, self.unparsed,
        )  # fmt: skip


class Cursor:
    """Tokens of a text, the clauses read so far, and the draft of the current one.

    Attributes:
        k: the next token.
        prep: preposition of the next noun, "" = none.
    """

    def __init__(self, text: str):
        self.text = text
        self.tokens = plainer(tokenize(text))
        self.k = 0
        self.clauses: list[Clause] = []
        self.unparsed: list[str] = []
        self.draft = Draft(0)
        self.prep = ""

    def _next(self, word: str, ahead: int = 1) -> bool:
        k = self.k + ahead
        return k < len(self.tokens) and self.tokens[k].text == word

    def _take(self, count: int) -> None:
        last = self.tokens[self.k + count - 1]
        self._extend(last)
        self.k += count

    def _extend(self, token: Token) -> None:
        if self.draft.empty and not self.draft.until and not self.draft.stop:
            self.draft.start = min(self.draft.start or token.start, token.start)
        self.draft.stop = max(self.draft.stop, token.stop)

    def _close_if_verb(self) -> None:
        if self.draft.verb:
            self._close()

    def _close(self) -> None:
        if not self.draft.empty:
            self.clauses.append(self.draft.done())
        here = self.tokens[self.k].stop if self.k < len(self.tokens) else len(self.text)
        self.draft = Draft(here)
        self.prep = ""
