"""Where a text says to stop."""

from __future__ import annotations

import re

from .clauses import Clause, Parse

# Prepositions of a place that one is at; the others lead on.
STATIC = frozenset(("near", "at", "before", "between", "in"))
_STAYING = STATIC | {"with", "after", "past"}
_UNTIL = re.compile(r"\s*,?\s*(?:until|till)\b", re.IGNORECASE)


def last_stop(parse: Parse) -> int | None:
    """Return the index of the clause that says where to stop, or None.

    `Walk on until you are next to the bed.` needs no word for stopping at the end of a text, and
    neither does a last clause that only puts the walker somewhere: `You should be at the bed now.`
    """
    stops = [k for k, c in enumerate(parse.clauses) if c.verb == "stop" and not c.negated]
    if stops:
        return stops[-1]
    last = parse.clauses[-1] if parse.clauses else None
    if last is None or last.before or last.negated or len(parse.clauses) < 2:
        return None
    if _arrives(last, parse.clauses[-2], parse) or _settles(last):
        return len(parse.clauses) - 1
    return None


def _arrives(last: Clause, before: Clause, parse: Parse) -> bool:
    """Return whether the last clause says how far to walk."""
    if not last.until or not last.nouns:
        return False
    bound = bool(_UNTIL.match(parse.text[last.start :]))
    if not bound and (before.verb in ("turn", "see", "") or before.side):
        return False
    arrives = last.verb in ("", "pass", "reach", "enter")
    return arrives or any(n.prep or n.side for n in last.nouns)


def _settles(last: Clause) -> bool:
    """Return whether the last clause moves nowhere: its verb is unknown, or keeps one there."""
    if last.side:
        return False
    if not last.nouns:
        return last.distance_m > 0 and last.verb == "" and last.unparsed > 0
    if last.verb in ("", "see") and last.unparsed:
        return all(n.prep in _STAYING for n in last.nouns)
    return last.verb == "move" and all(n.prep in ("near", "at", "before") for n in last.nouns)
