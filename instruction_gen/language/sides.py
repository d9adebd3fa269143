"""What a side is that of: a target before it, in a list or not, one after it, or a turn."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from .claims import Claim
from .clauses import Clause, degree_of, part_end, verb_at
from .phrases import read_distance, read_phrase, read_side
from .tables import closed
from .targets import sided
from .words import BENDS, ORDINALS, PREP_OF, RIGHT_ADVERB, SLIGHT

# "The table, which stays on your right": no way of the walker.
STAYS = closed("stays")
_RELATIVE = closed("relative")
_MOVES = ("turn", "enter", "leave")
WAYS = ("from", "into", "through")  # "it's right out of the bathroom" is a turn
AROUND = Claim("turn", side="around")
_ROUND = frozenset(("around", "round", "about"))
_ALONG = ("along", "past", "through", "into")
_KEEPS = ("keep", "keeping", "stay", "staying")
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
    _, _, from_k = read_distance(tokens, 0) or (0.0, False, 0)  # "…, 0.6 m on the left"
    rest = [t.text for t in (*tokens[from_k:k], *tokens[end:])]
    last = before.last
    moved = "again" in rest or bool(last and last.kind in ("door", "leave", "enter"))
    # "The table, which you will see on your right", "both of which are on the left".
    relative = placed and tokens[0].text in _RELATIVE and not any(
        (verb in _MOVES) if (verb := verb_at(tokens, n)) else read_phrase(tokens, n)
        for n in range(len(tokens))
    )  # fmt: skip
    if (set(rest) - _LISTING - STAYS and not relative) or (moved and not placed):
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
        return bool(STAYS & set(rest)) or bool(last and last.side)
    for owner, n in targets[-2:] if both else targets[-1:]:
        sided(owner.claims, n, side)
        if owner.claims[n].kind == "in" and not owner.prep and owner.verb in ("", "see"):
            owner.claims[n] = replace(owner.claims[n], kind="see")
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


def side_of(
    clause: Clause,
    k: int,
    read: tuple[str, bool, int],
    before: Clause | None,
    is_no_turn: Callable[[], bool],
) -> str:
    """Read the side at token `k`; return it where it is that of the phrase that follows.

    Args:
        read: as `read_side` returns it.
        before: the clause before.
        is_no_turn: whether the next word in doubt is no turn in this reading.
    """
    side, placed, end = read
    tokens, claims, verb = clause.tokens, clause.claims, clause.verb
    named = [n for n, c in enumerate(claims) if c.what and c.side in ("", "ahead")]
    last = claims[named[-1]] if named else Claim("turn")
    word = tokens[k - 1].text if k else ""
    after = tokens[end].text if end < len(tokens) else ""
    words = {t.text for t in tokens}
    ahead = side in ("ahead", "behind")
    degree, ordinal, used = "", 0, range(k, end)
    if verb == "go" and last.kind == "in" and tokens[k].text == "to" and not after:
        turn = True  # "take the hallway to the left"
    elif k == 0 and tokens[k].text == "to" and PREP_OF.get(after) in _ALONG and verb != "see":
        turn = True  # "then to the right along the windows"
    elif placed and verb == "go" and clause.prep == "around" and named and not after:
        turn = is_no_turn()  # "round the table on the left"
    else:  # "hallway left", "landing right"
        turn = (last.what == "room" and not (placed or ahead or verb)) and (
            last.name == "landing" or (last.kind == "in" and not is_no_turn())
        )
    alone = not placed and verb in ("", "see", "pass", "stop") and not after
    turned = any(c.kind == "turn" and c != AROUND for c in claims)
    if side == "right" and len(used) == len(tokens) and not (
        turn or placed or clause.joint or clause.until or not is_no_turn()
    ):  # fmt: skip
        return ""  # "Right, off we go"
    way = [t.text for t in tokens[:k]] == ["it", "is"] and after in ("", "again")
    seen = verb == "see" and PREP_OF.get(after) not in WAYS and not way
    if turn:
        pass
    elif named and (
        ahead
        or (alone and k and k - 1 in clause.used and clause.joint != "then")
        or (placed and (verb != "turn" or turned or not clause.has_verb))
    ):
        place(clause, named, side, before)
    elif ahead:
        clause.used.update(used)
        return side if verb in ("see", "") and not named else ""
    elif (
        (not placed and word in ("you", "have", "just", "we"))
        or (not placed and side == "right" and after in RIGHT_ADVERB and verb != "turn"
            and (verb not in ("go", "") or is_no_turn()))
        # "The left of the table", "right to the end of the hall".
        or after == "of"
        or (placed and tokens[0].text == "with")  # a thing that is in no table
        or (after == "to" and part_end(tokens, end + 1) > end + 1)
    ):  # fmt: skip
        return ""
    elif any(t.text in _KEEPS for t in tokens[:k]):
        if not named:
            return ""
        place(clause, named, side, before)
    elif seen or (
        placed and (verb in ("stop", "pass") or (not verb and after and word not in _ROUND))
    ):
        clause.used.update(used)
        return side
    elif verb in ("see", "turn", "go", "", "enter", "leave", "reach") and not clause.negated:
        turn = True
        ordinal = next((ORDINALS[t.text] for t in tokens[max(0, k - 2) : k]
                        if t.text in ORDINALS), 0)  # fmt: skip
        # "Curve around to the left", "bend left round the table": how far is not said.
        bent = words & BENDS and words & _ROUND and not words & SLIGHT
        degree = "" if bent else degree_of(tokens)
    else:
        return ""
    if turn:
        claims.append(Claim("turn", side=side, degree=degree, ordinal=ordinal))
    clause.used.update(used)
    return ""
