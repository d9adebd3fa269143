"""Sides that the grammar could bind to nothing: they may be turns.

`Round it to the left` and `right at the sofa, into the kitchen` tell a turn in words that no rule
reads for certain. Such a side accounts for a turn that no clause states, and claims nothing.
"""

import re
from collections import Counter

from ..language.clauses import Clause, Parse
from ..language.function_words import KEEP, RIGHT_ADVERB, VERB_OF

_SIDE = re.compile(
    r"\b(left|right)\b(?! (?:there|here|next|in front|beside|before|after|away|now|outside|inside|"
    r"behind|up|where|when|as|on)\b)",
    re.IGNORECASE,
)
# "With it on your left": the side of what was named before.
_ITS = re.compile(r"\b(?:it|them|this|that|both)(?: \w+)? (?:on|to) (?:your|the)\s*$", re.I)
_JOINED = re.compile(r"\b(?:and|then)\s*$", re.IGNORECASE)
_AT = re.compile(r"\b(?:is|are|be|'re|'s|stand|standing|wait|stop)\s*$", re.I)  # "you are right at"
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
            elif not any(p.search(parse.text[begin : match.start()]) for p in (_ITS, _AT)):
                loose.append(side)
        result.append(tuple(loose))
        begin = stop
    return result


def _bound(clause: Clause) -> list[str]:
    # To "the door on the left" one may have to turn first.
    placed = [
        n for n in clause.nouns if n.kind == "object" or (n.kind == "door" and n.prep != "to")
    ]
    sides = [n.side for n in placed if n.side in _SIDES]
    return [*sides, clause.side] if clause.side in _SIDES else sides


def elliptic(clause: Clause, parse: Parse) -> bool:
    """Return whether a side without a verb may be no turn: `right at the sofa`, unknown words."""
    words = re.findall(r"[a-z-]+", parse.text[clause.start : clause.stop].lower())
    if words and words[0] in KEEP and clause.degree == "slight":
        return True  # "keep slightly to the right" may be no turn
    if clause.side not in words or any(w in VERB_OF for w in words):
        return False
    if clause.unparsed:
        return True
    place = words.index(clause.side)
    if words[place - 2 : place] in (["to", "the"], ["to", "your"]) and clause.degree == "slight":
        return True  # "take the doorway ahead of you, slightly to the right"
    joined = {"then", "and"} & set(words[:place]) or _JOINED.search(parse.text[: clause.start])
    adverb = bool(RIGHT_ADVERB & set(words[place + 1 : place + 2]))
    return clause.side == "right" and not joined and adverb
