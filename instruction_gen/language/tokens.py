"""Words, numbers and punctuation, with their places in the text."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from .lexicon import OBJECT_PHRASES, ROOM_PHRASES, STOREY_PHRASES, singular
from .spelling import closed_gap, respelt
from .tables import closed, kind_of_word
from .words import LONGEST_PHRASE, NUMBERS, PREP_OF, VERB_OF, phrases

_TOKEN = re.compile(
    r"b4\b|[A-Za-z]+(?:[-'][A-Za-z]+)*[²³]?|\d+(?:\.\d+)?(?:[-–]\d+(?:\.\d+)?|st|nd|rd|th)?"
    r"|[^\sA-Za-z\d]",
    re.IGNORECASE,
)
# What is written short: "ur".
_SHORT = kind_of_word("short")
_ENDINGS = {
    "'ll": "will", "'re": "are", "'ve": "have", "'d": "would", "n't": "not", "'m": "am",
}  # fmt: skip
_LONGEST_NOUN = 4
_STOREY_OF = {"upper": "upstairs", "lower": "downstairs"}
# Marks that nothing follows: not "go in the kitchen", not "turn around the table".
_LONE = frozenset("GO_IN GO_OUT GO_THROUGH TURN_AROUND".split())
# What may follow `go in` where it is not "go in the kitchen".
_ALONE = closed("alone")
_PLACED = closed("place follows")


@dataclass(frozen=True)
class Token:
    """A word, in lower case, or a known phrase joined by blanks; its place in the text."""

    text: str
    start: int
    stop: int

    @property
    def is_word(self) -> bool:
        """Not punctuation."""
        return self.text[0].isalnum()


def tokenize(text: str) -> list[Token]:
    """Split a text; `living room` and other known nouns are one token each.

    Misspelt words are those that they are read as.
    """
    raw: list[Token] = []
    for match in _TOKEN.finditer(_plain(text)):
        word = match[0].lower()
        for own in (_SHORT.get(word) or respelt(word) or word).split():
            raw += _parts(own, match.start(), match.end())
    # "The table's on your left", but "the table's end".
    split: list[Token] = []
    for k, token in enumerate(raw):
        if token.text != "'s":
            split.append(token)
        elif k + 1 < len(raw) and raw[k + 1].text in _PLACED:
            split.append(replace(token, text="is"))
    return _meant(_nouns(split))


def misspelt(text: str) -> list[str]:
    """Return the words that are misspelt, each with how it is read."""
    words = [match[0].lower() for match in _TOKEN.finditer(_plain(text))]
    pairs = {f"{a} {b}": closed_gap(a, b) for a, b in pairwise(words) if not _is_noun(f"{a} {b}")}
    read = {word: respelt(word) for word in words if word not in _SHORT} | pairs
    return [f"{word} (read as {meant})" for word, meant in read.items() if meant]


def _plain(text: str) -> str:
    """Return a text of equal length without marks that stand for a blank or a semicolon."""
    text = re.sub(r"(?<=s)'(?=\s)", " ", text.replace("’", "'"))
    text = re.sub(r"\b(approx|ca|appr)\.", r"\1 ", text, flags=re.IGNORECASE)
    return text.replace("->", "; ").replace("→", ";").replace("~", " ")


def _parts(word: str, start: int, stop: int) -> list[Token]:
    """Return the words of a contraction or a compound."""
    for ending, meaning in _ENDINGS.items():
        if word.endswith(ending) and word != ending:
            cut = stop - len(ending)
            stem = word.removesuffix(ending)
            return [Token({"ca": "can", "wo": "will"}.get(stem, stem), start, cut),
                    Token(meaning, cut, stop)]  # fmt: skip
    if word in ("let's", "it's", "that's", "there's", "here's", "what's", "where's", "he's"):
        return [Token(word[:-2], start, stop - 2), Token("is", stop - 2, stop)]
    if word.endswith("'s") and not _is_noun(word) and len(word) > 2:
        return [Token(word[:-2], start, stop - 2), Token("'s", stop - 2, stop)]
    if "-" in word[1:] and word[0].isalpha() and not _is_noun(word) and word not in NUMBERS:
        result, at = [], start
        for part in word.split("-"):
            side = _SHORT[part] if part in ("l", "r") else part  # "ahead-R", but "U-turn"
            result.append(Token(side, at, at + len(part)))
            at += len(part) + 1
        return result
    return [Token(word, start, stop)]


def _is_noun(phrase: str) -> bool:
    return any(phrase in table for table in (OBJECT_PHRASES, ROOM_PHRASES, STOREY_PHRASES))


def _nouns(raw: list[Token]) -> list[Token]:
    """Join the words of known nouns."""

    def noun(words: Sequence[str], before: str, after: str) -> tuple[str, ...] | None:
        exact = " ".join(words)
        if exact in STOREY_PHRASES and _is_noun(f"{words[-1]} {after}"):
            return None  # "the second floor lamp"
        if exact in _STOREY_OF and after != "landing" and after in ROOM_PHRASES:
            return (_STOREY_OF[exact],)  # "the upper hallway"
        phrase = " ".join([*words[:-1], singular(words[-1])])
        if len(words) == 2 and not (_is_noun(phrase) or _is_noun(exact)):
            whole = closed_gap(*words)
            return (whole,) if whole else None
        return (exact,) if len(words) > 1 and (_is_noun(phrase) or _is_noun(exact)) else None

    return _replaced(raw, _LONGEST_NOUN, noun)


def _meant(raw: list[Token]) -> list[Token]:
    """Return the tokens with phrases of `words.phrases` read as other words."""
    table = phrases()

    def meaning(words: Sequence[str], before: str, after: str) -> tuple[str, ...] | None:
        result = table.get(tuple(words))
        alone = not after[0].isalnum() or after in _ALONE
        if (
            result and result[0] == "TURN_AROUND"
        ):  # "a U-turn at the sofa", "turn around to the left"
            alone = alone or after in PREP_OF or words[-1] not in ("around", "round")
        # "Turn right there", "at the right there is a table".
        turned = VERB_OF.get(before) == "turn" or before in ("the", "your", "on", "at", "to")
        turned = turned and words[0] == "right"
        return None if turned or (result and result[0] in _LONE and not alone) else result

    return _replaced(raw, LONGEST_PHRASE, meaning)


def _replaced(
    raw: list[Token], longest: int, by: Callable[[Sequence[str], str, str], tuple[str, ...] | None]
) -> list[Token]:
    """Replace the longest runs of tokens for which there are other words, given those around."""
    result: list[Token] = []
    texts = [token.text for token in raw] + ["."]
    k = 0
    while k < len(raw):
        size, words = 1, (raw[k].text,)
        for more in range(min(longest, len(raw) - k), 0, -1):
            if (other := by(texts[k : k + more], texts[k - 1], texts[k + more])) is not None:
                size, words = more, other
                break
        result += [Token(word, raw[k].start, raw[k + size - 1].stop) for word in words]
        k += size
    return result
