"""Sides without any other word, which may belong to the thing named before them.

In `between the counter, left, and the table (right)` no turn is told; in `past the bed, left, …`
one is. The words alone do not say which: a text is read both ways, and in one way throughout.
"""

import re
from dataclasses import replace

from .clauses import Clause, Parse

_SIDE = r"(?:also |just |both )?(?:ahead )?(?:to |on )?(?:the |your )?(?:left|right)(?: of you)?"
_BARE = re.compile(rf"\W*{_SIDE}\W*", re.IGNORECASE)
_PLACED = r"(?:(?:is|are|stays?|stands?|off|always|now) )?"
_JOINED = rf"[ (–—]+{_PLACED}{_SIDE}\W*"
_APART = rf" ?, ?{_PLACED}{_SIDE}\W*"
# "Right, off we go": who says so has not turned yet.
_OPENS = re.compile(r"\W*right(?:,|[.!] )(?! (?:and|then)\b)", re.IGNORECASE)


def with_asides(parse: Parse) -> Parse | None:
    """Return the text with all such sides as those of things, None where it has none."""
    clauses = parse.clauses
    of = [_aside(k, parse, _JOINED) for k in range(len(clauses))]
    apart = [_aside(k, parse, _APART) for k in range(len(clauses))]
    # "Past the bed, left": behind a comma they are sides of things where the text has more of them.
    if sum(one is not None for one in (*of, *apart)) > 1:
        of = [one or other for one, other in zip(of, apart, strict=True)]
    meant = [one or clause for one, clause in zip(of, clauses, strict=True)]
    if clauses and _bare(clauses[-1], parse) and of[-1] is None:
        # "Stop when it is beside you, left."
        things = [n for c in clauses for n in c.nouns if n.kind == "object"][-1:]
        side = clauses[-1].side
        nouns = tuple(replace(n, side=side, prep="with") for n in things)
        meant[-1] = replace(clauses[-1], verb="see", side="", degree="", nouns=nouns)
    if clauses and _bare(clauses[0], parse) and _OPENS.match(parse.text):
        meant = meant[1:]
    result = replace(parse, clauses=tuple(meant))
    return None if result == parse else result


def _bare(clause: Clause, parse: Parse) -> bool:
    said = parse.text[clause.start : clause.stop]
    return bool(clause.side) and not clause.nouns and _BARE.fullmatch(said) is not None


def _aside(k: int, parse: Parse, form: str) -> Clause | None:
    """Return clause `k` with its side as that of the thing before it, None where there is none.

    Args:
        form: what follows the thing's name.
    """
    clause = parse.clauses[k]
    of = parse.clauses[k - 1] if k and _bare(clause, parse) else clause
    noun = of.nouns[-1] if of.nouns else None
    if noun is None or noun.kind not in ("object", "door") or noun.side or clause.verb != "turn":
        return None
    said = parse.text[of.start : clause.stop].lower()
    out = noun.kind == "door" and (of.verb == "leave" or noun.prep in ("from", "through"))
    if out or not re.fullmatch(f".*{re.escape(noun.text)}{form}", said, re.DOTALL):
        return None
    sided = replace(noun, side=clause.side)
    if of is clause:
        return replace(clause, verb="", side="", degree="", nouns=(*clause.nouns[:-1], sided))
    nouns = (replace(sided, prep="with"),)
    return replace(clause, verb="see", side="", degree="", nouns=nouns, meanwhile=True)
