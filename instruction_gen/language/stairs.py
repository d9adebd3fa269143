"""What a text says of stairs: `up the stairs`, `at the top`, `halfway`, `upstairs`."""

from dataclasses import replace
from itertools import pairwise

from .claims import Claim
from .clauses import Clause
from .lexicon import OBJECT_PHRASES
from .tables import closed
from .words import DETERMINERS, PRONOUNS, number_of

_UP, _DOWN, _CLIMBS, _TAKES, _BEGINS = (
    closed(name) for name in ("up", "down", "climbs", "takes", "begins")
)
_PLACES = {word: place for place in ("top", "bottom", "halfway") for word in closed(place)}
_ALONE = closed("stairs place")  # not `the head`
_STOREY_WAYS = {"upstairs": "up", "downstairs": "down"}
_LAST = PRONOUNS | frozenset(("again", "further", "on", "there", "first", "you", "we", "go"))
_STOREYS = closed("storeys")


def is_stairs(target: Claim) -> bool:
    """Return whether a target is stairs."""
    return target.what == "thing" and "stairs" in OBJECT_PHRASES.get(target.name, ())


def look_for_stairs(clause: Clause) -> None:
    """Remember what a clause says of up and down, and of the place on stairs."""
    words = [*(token.text for token in clause.tokens), ""]
    for word, after in pairwise(words):
        clause.way = "up" if word in _UP else "down" if word in _DOWN else clause.way
        if word in _PLACES and (after == "of" or word in _ALONE):
            clause.place = _PLACES[word]


def on_stairs(
    target: Claim, k: int, prep: str, clause: Clause, claim: Claim, joined: bool
) -> list[Claim]:
    """Return what a clause claims of stairs or of a storey that is named at token `k`.

    Args:
        claim: what it would claim of any other target.
        joined: the storey is that of a room or thing that follows: `down the upstairs hallway`.
    """
    climbs = any(c.kind == "climb" for c in clause.claims)
    goes = clause.verb in ("go", "turn", "leave", "")
    words = [token.text for token in clause.tokens]
    while k and (words[k - 1] in DETERMINERS or words[k - 1] in ("to", "on", "onto", "into")):
        k -= 1
    near = k > 0 and (
        words[k - 1] in _UP | _DOWN or (bool(clause.way) and words[k - 1] in ("via", "using"))
    )
    if target.what == "storey":
        alone = bool(clause.joint) and not clause.verb and len(words) == 1  # "left, upstairs"
        after = bool(clause.claims) and k - 1 in clause.used  # "along the hall upstairs"
        adverb = target.name in _STOREY_WAYS and (clause.verb == "go" or alone) and not prep
        way = clause.way * near or _STOREY_WAYS.get(target.name, "") * adverb
        if climbs or joined or after or not (way and goes) or clause.says(*_BEGINS):
            return [claim]
        # "Head upstairs, turning left on the landing": one is not yet there.
        return [Claim("climb", way=way), *[claim] * (target.name not in _STOREY_WAYS)]
    if climbs:
        return []
    to_take = prep == "to" and any(a == "to" and b in _TAKES for a, b in pairwise(words))
    taken = to_take or (not prep and (clause.says(*_TAKES) or (clause.way and goes)))
    if (near and goes) or taken:
        place = "halfway" * (clause.place == "halfway")
        return [replace(target, kind="climb", way=clause.way, place=place)]
    kind = "reach" if clause.place and claim.kind == "see" else claim.kind
    return [replace(claim, kind=kind, place=clause.place or claim.place)]


def add_unsaid(clause: Clause, before: Clause | None, spoken: bool) -> None:
    """Add what a clause claims of stairs without naming them, and how many it climbs.

    Args:
        spoken: the text has spoken of stairs before.
    """
    clause.claims[:0] = _unnamed_stairs(clause, spoken)
    _count_storeys(clause)
    _count_flights(clause, before)


def _count_storeys(clause: Clause) -> None:
    """Read over how many storeys a clause goes: `climb two floors`."""
    words = [token.text for token in clause.tokens]
    end = next((k for k, word in enumerate(words) if word in _STOREYS), 0)
    k = next((k for k in range(max(0, end - 2), end) if (number_of(words[k]) or 0) >= 1), -1)
    n = next((n for n, c in enumerate(clause.claims) if c.kind == "climb"), len(clause.claims))
    if k >= 0 and clause.way and clause.verb != "see" and not clause.negated:
        climb = replace((clause.claims[n:] or [Claim("climb", way=clause.way)])[0], name="")
        count = int(number_of(words[k]) or 0)
        clause.claims[n : n + 1] = [replace(climb, what="storey", count=count)]
        clause.used.update((k, end))


def _count_flights(clause: Clause, before: Clause | None) -> None:
    """Count the flights of stairs that the clause before climbs: `up the stairs, two flights`."""
    last, own = before and before.last, clause.claims
    bare = len(own) == 1 and own[0].count and is_stairs(own[0]) and not clause.has_verb
    if before and last and last.kind == "climb" and bare and last.what != "storey":
        before.claims[-1], own[:] = replace(last, count=own[0].count), []


def _unnamed_stairs(clause: Clause, spoken: bool) -> list[Claim]:
    """Return what a clause claims of stairs that it does not name: `go up`, `at the top`."""
    words = [token.text for token in clause.tokens]
    if clause.negated or any(c.kind == "climb" or is_stairs(c) for c in clause.claims):
        return []
    k = max((k for k, word in enumerate(words) if word in _UP | _DOWN), default=-1)
    bare = spoken and clause.verb in ("go", "") and all(word in _LAST for word in words[k + 1 :])
    if k >= 0 and (bare or clause.says(*_CLIMBS)):
        return [Claim("climb", way=clause.way)]
    alone = [w for w, after in pairwise([*words, ""]) if w in _ALONE and after != "of"]
    if spoken and alone:
        kind = "stop" if clause.verb == "stop" else "reach"
        return [Claim(kind, "thing", "stairs", place=_PLACES[alone[-1]])]
    return []
