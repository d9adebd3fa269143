"""Words, numbers and punctuation, with their places in the text."""

import re
from dataclasses import dataclass

from .lexicon import DOORS, OBJECT_PHRASES, ROOM_PHRASES, singular

_TOKEN = re.compile(r"[A-Za-z]+(?:[-'’][A-Za-z]+)*|\d+(?:\.\d+)?(?:st|nd|rd|th)?|[^\sA-Za-z\d]")
_CONTRACTIONS = {
    "you'll": "you will", "there's": "there is", "don't": "do not", "it's": "it is",
    "that's": "that is", "you've": "you have", "you're": "you are", "doesn't": "does not",
}  # fmt: skip
_LONGEST = 4
_OWNERS = frozenset((OBJECT_PHRASES.keys() | ROOM_PHRASES.keys() | DOORS) - {"it", "child"})
_NEXT_WORD = re.compile(r"\s+([A-Za-z]+)")
_PLACED = frozenset("ahead on in behind to at right left off next beside just there".split())


@dataclass(frozen=True)
class Token:
    """A word, in lower case, or a multi-word noun joined by blanks."""

    text: str
    start: int
    stop: int

    @property
    def is_word(self) -> bool:
        """Not punctuation."""
        return self.text[0].isalnum()


def tokenize(text: str) -> list[Token]:
    """Split a text; `living room` and other known phrases are one token each."""
    raw: list[Token] = []
    # "The kids' room": the apostrophe is dropped, at its place.
    plain = re.sub(r"(?<=s)'(?=\s)", " ", text.replace("’", "'"))
    for match in _TOKEN.finditer(plain):
        word = match[0].lower()
        for part in _CONTRACTIONS.get(word, word).split():
            # "The table's on your left" and "the study's door", but "children's room".
            owner = part.removesuffix("'s")
            if owner != part and (owner in _OWNERS):
                after = _NEXT_WORD.match(plain, match.end())
                raw.append(Token(owner, match.start(), match.end() - 2))
                if after and after[1].lower() in _PLACED:
                    raw.append(Token("is", match.end() - 1, match.end()))
                continue
            raw.append(Token(part, match.start(), match.end()))
    result: list[Token] = []
    k = 0
    while k < len(raw):
        for size in range(min(_LONGEST, len(raw) - k), 1, -1):
            words = [t.text for t in raw[k : k + size]]
            phrase = " ".join([*words[:-1], singular(words[-1])])
            exact = " ".join(words)
            if any(p in OBJECT_PHRASES or p in ROOM_PHRASES for p in (phrase, exact)):
                result.append(Token(exact, raw[k].start, raw[k + size - 1].stop))
                k += size
                break
        else:
            result.append(raw[k])
            k += 1
    return result
