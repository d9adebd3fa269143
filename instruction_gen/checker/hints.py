"""Sides that the grammar could bind to nothing: they may be turns.

`Round it to the left` and `right at the sofa, into the kitchen` tell a turn in words that no rule
reads for certain. Such a side accounts for a turn that no clause states, and claims nothing.
"""

from __future__ import annotations

import re
from collections import Counter

from ..language.clauses import Clause, Parse
from ..language.function_words import RIGHT_ADVERB, VERB_OF

_SIDE = re.compile(
    r"\b(left|right)\b(?! (?:there|here|next|in front|beside|before|after|away|now|outside|inside|"
    r"behind|up|where|when|as|on)\b)",
    re.IGNORECASE,
)
_SIDES = ("left", "right")


def loose_sides(parse: Parse) -> list[tuple[str, ...]]:
    """Return for each clause the sides in it that belong to no turn and to no object."""
    result = []
    bound: Counter[str] = Counter()
    begin = 0
    for index, clause in enumerate(parse.clauses):
        last = index == len(parse.clauses) - 1
        stop = len(parse.text) if last else max(begin, clause.stop)
        bound.update(_bound(clause))
        loose = []
        for match in _SIDE.finditer(parse.text, begin, stop):
            side = match[1].lower()
            if bound[side] > 0:
                bound[side] -= 1
            else:
                loose.append(side)
        result.append(tuple(loose))
        begin = stop
    return result


def _bound(clause: Clause) -> list[str]:
    sides = [n.side for n in clause.nouns if n.kind == "object" and n.side in _SIDES]
    return [*sides, clause.side] if clause.side in _SIDES else sides


def elliptic(clause: Clause, parse: Parse) -> bool:
    """Return whether a side without a verb may be no turn: `right at the sofa`, unknown words."""
    words = re.findall(r"[a-z-]+", parse.text[clause.start : clause.stop].lower())
    if clause.side not in words or any(w in VERB_OF for w in words):
        return False
    if clause.unparsed:
        return True
    place = words.index(clause.side)
    joined = {"then", "and"} & set(words[:place])
    adverb = bool(RIGHT_ADVERB & set(words[place + 1 : place + 2]))
    return clause.side == "right" and not joined and adverb
