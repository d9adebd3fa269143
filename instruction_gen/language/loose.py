"""Words of a clause that no claim covers, and those that stand for things in no table."""

from collections.abc import Sequence

from .claims import Step
from .clauses import Clause, verb_at
from .ending import MOVES
from .lexicon import noun_kind
from .phrases import read_phrase
from .tables import closed
from .words import DETERMINERS, NEGATIONS, PREP_OF, SMALL, is_known, number_of

_ADJECTIVE = (
    "y", "ed", "ing", "ful", "ous", "ive", "al", "less", "ish", "en", "ern", "ic", "ly", "est",
    "ible", "able",
)  # fmt: skip


_PAST = ("had", "was", "were", "once")
_FEELS = closed("feels")
_ANYBODY, _MAY = ("one", "people", "guests"), ("may", "might", "can", "could")
_NO_ARTICLES = ("that", "this", "my", "your", "our", "his", "her", "their")


def step_of(clause: Clause, text: str) -> Step:
    """Return a clause that is read as a step."""
    start, stop = clause.tokens[0].start, clause.tokens[-1].stop
    loose = [
        t.text
        for k, t in enumerate(clause.tokens)
        if k not in clause.used and t.is_word and not t.text.isupper() and _is_content(t.text)
    ]
    return Step(text[start:stop], tuple(clause.claims), start, tuple(loose), tuple(clause.faults))


def _is_content(word: str) -> bool:
    """Return whether a word says something that should be covered by a claim."""
    return _is_closed(word) or word not in SMALL | {"'s"}


def _is_closed(word: str) -> bool:
    """Return whether a word is a side, a number or a negation."""
    return word in ("left", "right") or number_of(word) is not None or word in NEGATIONS


def remarks(words: Sequence[str]) -> bool:
    """Return whether words are an aside: `I used to slide on the banister`, `such a lot of books`.

    They tell of the past or of what a speaker feels, warn, or say what anybody may do.
    """
    who, did = [*words, "", ""][:2]
    if who in ("i", "we", "he", "she"):
        past = did in _PAST or (did.endswith("ed") and not did.endswith("eed"))  # no need
        return past or not _FEELS.isdisjoint(words[1:4])
    return who == "such" or "mind" in (who, did) or (who in _ANYBODY and did in _MAY)


def is_aside(clause: Clause) -> bool:
    """Return whether a clause is an aside that says no side, way, stop or thing.

    "Mind the sofa and keep it on your left" tells where the sofa is.
    """
    words = [token.text for token in clause.tokens]
    way = any(c.side or c.kind in MOVES for c in clause.claims) or any(map(noun_kind, words))
    return remarks(words) and not way and (clause.verb in ("", "see") or words[0] in _ANYBODY)


def find_fault(clause: Clause, k: int) -> None:
    """Find fault with a word that stands for a thing and is in no table."""
    tokens, word = clause.tokens, clause.tokens[k].text
    known = is_known(word) or bool(verb_at(tokens, k))
    if known or not word.isalpha():
        if known and not _is_closed(word):
            clause.used.add(k)
        return
    before = tokens[k - 1].text if k else ""
    after = tokens[k + 1].text if k + 1 < len(tokens) else ""
    if word.endswith(_ADJECTIVE):
        return
    named = before in DETERMINERS and before not in _NO_ARTICLES  # not "mind your toes"
    if read_phrase(tokens, k + 1) and after not in PREP_OF and after not in DETERMINERS:
        clause.faults.append(f"{word} {after}: no such thing is known")
    elif (
        named
        and (  # what is carried is on no way
            (k > 1 and tokens[k - 2].text in PREP_OF)
            or clause.verb in ("pass", "reach", "stop")
            or not {"left", "right"}.isdisjoint(t.text for t in tokens[k + 1 : k + 5])
        )
    ):
        clause.faults.append(f"{word}: no such thing or place is known")
