"""What words that name nothing refer to: `stop there`, `the second one`, `go in`."""

from collections.abc import Sequence
from dataclasses import replace

from .claims import Claim
from .clauses import Clause
from .words import ORDINALS, PREP_OF


def stop_at_it(clause: Clause, before: Clause | None) -> Claim:
    """Return the stop of a clause that names no place: at `it`, or at what was reached last."""
    last = (before and before.last) or Claim("stop")
    named = last.what == "thing" and (
        (last.kind == "reach" and not clause.claims)  # not "and stop after two metres"
        or clause.says("it", "them", "there")
        or (clause.says("that", "which") and clause.says("where"))
    )
    return replace(last, kind="stop", side="", place="at") if named else Claim("stop")


def counted_again(clause: Clause, k: int, before: Clause | None) -> list[Claim] | None:
    """Return what `the second (one)` at token `k` adds to the claims, None where it is none."""
    tokens, claims = clause.tokens, clause.claims
    one = tokens[k].text == "one"
    last = ORDINALS.get(tokens[k - one].text, 0) if k or not one else 0
    end = one or k + 1 == len(tokens) or tokens[k + 1].text in PREP_OF
    if not (last and end and k):
        return None
    if claims and claims[-1].what:  # "the door is the first one on the left"
        claims[-1] = replace(claims[-1], ordinal=last)
        return []
    door = before and before.last
    if door is None or door.what != "door" or door.kind not in ("pass", "see"):
        return None
    return [replace(door, kind="door", ordinal=last)]  # "pass one door, go in at the second"


def is_inside(said: Sequence[Clause]) -> bool:
    """Return whether the last that is claimed is that a room is entered."""
    claims = [claim for clause in said for claim in clause.claims]
    return bool(claims) and claims[-1].kind in ("enter", "door")


def marked(mark: str, door: Claim | None) -> Claim:
    """Return what `go in`, `go out` and `go through` claim of what was named before."""
    if mark == "GO_OUT":
        return Claim("leave", "room")
    if door is None:
        return Claim("door", "door")
    kind = "enter" if door.what == "room" else "door"
    return Claim(kind, door.what, door.name, door.side, door.ordinal, room=door.room)
