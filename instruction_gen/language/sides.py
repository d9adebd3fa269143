"""Sides that belong to a target named before: in a list, or after it."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from .clauses import Clause, verb_at
from .phrases import read_phrase, read_side
from .tables import closed
from .targets import sided
from .words import PREP_OF

# "The table, which stays on your right": no way of the walker.
_STAYS = closed("stays")
_RELATIVE = closed("relative")
_WAYS = ("turn", "enter", "leave")
_LISTING = closed("in a list")


def listed_side(
    clause: Clause, said: Sequence[Clause], before: Clause | None, is_no_turn: Callable[[], bool]
) -> bool:
    """Give a side that is a clause of its own to what is before: `…, both on the left`."""
    tokens = clause.tokens
    k = next((k for k in range(len(tokens)) if read_side(tokens, k)), -1)
    if k < 0 or before is None or not (clause.joint or clause.until):
        return False
    side, placed, end = read_side(tokens, k) or ("", False, 0)
    rest = [t.text for t in (*tokens[:k], *tokens[end:])]
    last = before.last
    moved = "again" in rest or bool(last and last.kind in ("door", "leave", "enter"))
    # "The table, which you will see on your right", "both of which are on the left".
    relative = placed and tokens[0].text in _RELATIVE and not any(
        (verb in _WAYS) if (verb := verb_at(tokens, n)) else read_phrase(tokens, n)
        for n in range(len(tokens))
    )  # fmt: skip
    if (set(rest) - _LISTING - _STAYS and not relative) or (moved and not placed):
        return False
    both = "both" in rest or "all" in rest
    if not placed and not both and clause.joint != "(" and not (
        clause.joint in (",", "-", "–", "—") and is_no_turn()
    ):  # fmt: skip
        return False
    if {"two", "three", "one"} & set(rest):
        return True  # as many again: what they are is said before
    targets = [(c, n) for c in said for n, x in enumerate(c.claims)
               if x.what and x.kind != "walk" and not x.side]  # fmt: skip
    if not targets or targets[-1][0] is not before:
        return bool(_STAYS & set(rest)) or bool(placed and last and last.side)
    for owner, n in targets[-2:] if both else targets[-1:]:
        sided(owner.claims, n, side)
    clause.used.update(range(len(tokens)))
    return True


def place(clause: Clause, named: list[int], side: str, before: Clause | None) -> None:
    """Give a side to the last target, and to the one that is listed with it."""
    claims = clause.claims
    sided(claims, named[-1], side)
    if claims[named[-1]].kind == "in" and not clause.prep:  # "meeting room left"
        claims[named[-1]] = replace(claims[named[-1]], kind="see")
    left = side in ("left", "right") and clause.says("leave", "leaving") and not clause.prep
    if claims[named[-1]].kind == "door" and left:
        claims[named[-1]] = replace(claims[named[-1]], kind="pass")  # "leave its door on the left"
    listed = clause.joint == "and" and clause.tokens[0].text not in PREP_OF
    if listed and before is not None and len(named) == 1 and not clause.has_verb:
        last = before.last
        if last and last.what == claims[named[-1]].what and last.side in ("", "ahead") \
                and side not in ("ahead", "behind"):  # fmt: skip
            sided(before.claims, -1, side)
