"""Where a text says to stop."""

import re
from collections.abc import Sequence

from .clauses import Clause, Noun, Parse

# Prepositions of a place that one is at; the others lead on.
STATIC = frozenset(("near", "at", "before", "between", "in"))
STAYING = STATIC | {"with", "after", "past"}
_TO = re.compile(r"\b(?:to|as far as)\s+(?:the|a|an|your)\b[^,.;]*$", re.IGNORECASE)
_SAYING = re.compile(r"\s*,\s*(?!you\b)\w")
_UNTIL = re.compile(r"\s*,?\s*(?:until|till)\b", re.IGNORECASE)


def places(clauses: Sequence[Clause]) -> list[Noun]:
    """Return the nouns that name a thing, a room or a door."""
    return [n for c in clauses for n in c.nouns if n.kind in ("object", "room", "door")]


def last_stop(parse: Parse) -> int | None:
    """Return the index of the clause that says where to stop, or None.

    `Walk on until you are next to the bed.` needs no word for stopping at the end of a text, and
    neither does a last clause that only puts the walker somewhere: `You should be at the bed now.`
    """
    stops = [k for k, c in enumerate(parse.clauses) if c.verb == "stop" and not c.negated]
    if stops:
        return stops[-1]
    end = len(parse.clauses) - 1
    while end >= 0 and parse.clauses[end].negated:  # "…, but do not go in."
        end -= 1
    last = parse.clauses[end] if end >= 0 else None
    if last is None or last.before or len(parse.clauses) < 2:
        return None
    if (end and _arrives(last, parse.clauses[end - 1], parse)) or _settles(last):
        return end
    until = end
    while until > 1 and _there(parse.clauses[until]):  # "until you reach the bed, near the window"
        until -= 1
    if until and _arrives(parse.clauses[until], parse.clauses[until - 1], parse):
        return until
    if _destined(last, parse) or (end < len(parse.clauses) - 1 and _bounded(parse, end)):
        return end
    return _measured(parse, end)


def destination(clause: Clause, parse: Parse) -> bool:
    """Return whether a clause without a word for stopping names where the walk ends."""
    return clause.verb != "stop" and not clause.until and _destined(clause, parse)


def goal_index(clause: Clause) -> int:
    """Return which noun of a clause is where it leads: `to the radiator beneath the window`."""
    k = len(clause.nouns) - 1
    while k > 0 and clause.nouns[k].prep != "to" and clause.nouns[k].prep in STAYING:
        k -= 1
    return k


def _destined(last: Clause, parse: Parse) -> bool:
    """Whether a clause leads to a place that one stands at: `to the window`, `up to the door`."""
    if not last.nouns or last.verb not in ("", "move", "turn", "pass") or last.until:
        return False
    goal = last.nouns[goal_index(last)]
    place = goal.kind in ("object", "door") or goal.part in ("entrance", "threshold", "mouth")
    said = parse.text[last.start : last.stop]
    return place and goal.prep == "to" and bool(_TO.search(said))


def _bounded(parse: Parse, end: int) -> bool:
    """Whether what must not be entered after clause `end` is where the walk ends."""
    inside = ("into", "through")
    beyond = [
        c for c in parse.clauses[end + 1 :] if c.verb in ("enter", "move") and (
            c.verb == "enter" or any(n.prep in inside for n in c.nouns)
        )
    ]  # fmt: skip
    return bool(beyond) and parse.clauses[end].verb in ("move", "reach", "")


def _measured(parse: Parse, end: int) -> int | None:
    """Return the clause that ends a text by how far to walk, None where none does."""
    static = [c.verb in ("see", "") and not c.side and not c.distance_m for c in parse.clauses]
    while end > 0 and static[end]:  # "The bed is now on your left."
        end -= 1
    for k in range(end, max(-1, end - 2), -1):
        clause = parse.clauses[k]
        if clause.distance_m and clause.verb == "move":
            return k
        if clause.side and not clause.meanwhile:
            return None
    return None


def _there(clause: Clause) -> bool:
    """Whether a clause only says what is where one is."""
    here = all(n.prep in ("", "with") or n.prep in STATIC for n in clause.nouns)
    return here and clause.verb in ("", "see") and not (clause.side or clause.until)


def _arrives(last: Clause, before: Clause, parse: Parse) -> bool:
    """Return whether a clause says until when to walk."""
    if not last.until or not last.nouns:
        return False
    bound = bool(_UNTIL.match(parse.text[last.start :]))
    # "Where there is a mirror on your right, …": whatever is said then, it is not where to go on.
    bound = bound or (last is parse.clauses[-1] and bool(_SAYING.match(parse.text, last.stop)))
    if not bound and (before.verb in ("turn", "see", "") or before.side):
        return False
    arrives = last.verb in ("", "pass", "reach", "enter")
    return arrives or any(n.prep or n.side for n in last.nouns)


def _settles(last: Clause) -> bool:
    """Return whether the last clause moves nowhere: its verb is unknown, or keeps one there."""
    if last.side:
        return False
    if not places([last]):
        return last.distance_m > 0 and last.verb == "" and last.unparsed > 0
    if last.verb in ("", "see") and last.unparsed:
        return all(n.prep in STAYING for n in last.nouns)
    return last.verb == "move" and all(n.prep in ("near", "at", "before") for n in last.nouns)
