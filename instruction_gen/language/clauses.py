"""What a text says, clause by clause."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Noun:
    """A noun phrase.

    Attributes:
        text: as written, without its determiner.
        kind: `object`, `room`, `door`, `generic`, `side` or `unknown`.
        head: the phrase to look things up by, in the singular.
        plural: more than one.
        number: a count said (`two chairs`), 0 = none.
        ordinal: a place said (`the third chair`), 0 = none.
        colour: canonical colour said, "" = none.
        material: material said, "" = none.
        only: said to be the only one.
        side: `left`, `right`, `behind` or `beside` where it is said to be, "" = not said.
        prep: the preposition before it, "" = none.
        part: a part or place of it that is meant (`end`, `other side`), "" = itself.
        start, stop: first token and one past the last.
    """

    text: str
    kind: str
    head: str
    plural: bool = False
    number: int = 0
    ordinal: int = 0
    colour: str = ""
    material: str = ""
    only: bool = False
    side: str = ""
    prep: str = ""
    part: str = ""
    start: int = 0
    stop: int = 0


@dataclass(frozen=True)
class Clause:
    """One verb and what goes with it.

    Attributes:
        start, stop: characters of the text.
        verb: `turn`, `move`, `enter`, `leave`, `pass`, `stop`, `see`, `reach` or "".
        side: `left`, `right` or `around` of a turn, "" = none.
        degree: `slight`, `sharp`, `some` (`bear`, `veer`) or "" of a turn.
        nouns: in order.
        distance_m: how far to move [m], 0 = not said.
        vague: the distance is `a few metres` or the like.
        negated: it says what not to do.
        there: it says to stop there, here, now.
        until: it begins with `until`, `when`, `once`, …
        before: it begins with `before`: what it names has not been reached.
        meanwhile: a participle after a comma: it holds around the clause before it.
        unparsed: how many of its words fit nowhere in the grammar.
    """

    start: int
    stop: int
    verb: str
    side: str = ""
    degree: str = ""
    nouns: tuple[Noun, ...] = ()
    distance_m: float = 0.0
    vague: bool = False
    negated: bool = False
    there: bool = False
    until: bool = False
    before: bool = False
    meanwhile: bool = False
    unparsed: int = 0


@dataclass(frozen=True)
class Parse:
    """A text, read.

    Attributes:
        unparsed: words that fit nowhere in the grammar.
    """

    text: str
    clauses: tuple[Clause, ...]
    words: int
    unparsed: tuple[str, ...] = field(default=())
