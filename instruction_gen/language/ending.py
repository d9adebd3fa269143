"""Where a text stops, which may be said first, last, or only implied by where the walk ends."""

from dataclasses import replace

from .claims import Claim
from .clauses import Clause
from .phrases import read_side
from .stairs import is_stairs
from .tables import closed

MOVES = frozenset("leave enter door turn climb pass reach walk".split())
# The first sentence says where the walk ends, if one of these is in it: the first ones if the text
# says to stop as well.
_ANNOUNCE = closed("announces")
_SEEN = {("see", "thing")}
_MAY_ANNOUNCE = _ANNOUNCE | closed("may announce")


def arrange(clauses: list[Clause]) -> None:
    """Put what is named with a turn before it, and the stop at the end."""
    for k, clause in enumerate(clauses):
        after = clauses[k + 1] if k + 1 < len(clauses) else Clause([])
        if after.joint in ("and", "or") and after.verb == "see" and not clause.verb and any(
            c.kind == "in" for c in clause.claims
        ):  # fmt: skip
            clause.claims = []  # "kitchen and living room are the other way"
        n = next((n for n, c in enumerate(clause.claims) if c.kind == "turn"), -1)
        if n >= 0:
            clause.claims = [*clause.claims[:n], *_turned(clause.claims[n:])]
        before = next((c for c in reversed(clauses[:k]) if c.tokens), None)
        if before is not None and clause.joint == "then" and before.lists_first:
            _in_order(before, clause)
        # "Turn left when you reach the sofa": the sofa comes first.
        before = clauses[k - 1] if k else None
        if (
            clause.until and before is not None and clause.claims and before.verb == "turn"
            and before.claims and not clause.joint and before.sentence == clause.sentence
            and all(c.kind in ("see", "reach", "in", "pass") for c in clause.claims)
        ):  # fmt: skip
            before.claims, clause.claims = clause.claims + before.claims, []
    spoken = [clause for clause in clauses if clause.tokens]
    if spoken:
        _end(spoken)


def _in_order(first: Clause, then: Clause) -> None:
    """Read things that are seen in an order as passed; a side before or after both is that of both.

    "On your left comes first the sofa, and after it the lamp."
    """
    one, other = first.last, then.claims[0] if then.claims else None
    if one is None or other is None or {(c.kind, c.what) for c in (one, other)} != _SEEN:
        return
    shared = {one.side, other.side}
    if (other.side and first.has_verb) or (one.side and not read_side(first.tokens, 0)):
        shared = set()
    side = max(shared) if len(shared) == 2 else ""
    first.claims[-1] = replace(one, kind="pass", side=one.side or side)
    then.claims[0] = replace(other, kind="pass", side=other.side or side)


def _turned(claims: list[Claim]) -> list[Claim]:
    """Return the claims of a turn and what follows it, in the order of the walk."""
    marks = [c for c in claims[1:] if c.kind in ("reach", "see")
             and (c.what in ("thing", "door") or c.name == "landing")
             and (c.place or not is_stairs(c))]  # fmt: skip
    turn, *rest = [c for c in claims if c not in marks]
    if rest and rest[0].kind in ("enter", "door", "leave", "climb") and not rest[0].side \
            and turn.side in ("left", "right"):  # fmt: skip
        rest[0] = replace(rest[0], side=turn.side)  # "turn left into the kitchen"
    return [*marks, turn, *rest]


def _end(clauses: list[Clause]) -> None:
    """Leave one stop, after which nothing moves."""
    stops = [k for k, c in enumerate(clauses) if any(x.kind == "stop" for x in c.claims)]
    if _announced(clauses, bool(stops)):
        stops = [k for k in stops if any(x.kind == "stop" for x in clauses[k].claims)]
    elif not stops:
        _stop_where_the_walk_ends(clauses)
    if not stops:
        return
    moves = [k for k, c in enumerate(clauses) if any(x.kind in MOVES for x in c.claims)]
    if goal := _goal_before_the_way(clauses, stops, moves):
        moved = [c for k in goal for c in clauses[k].claims]
        for k in goal:
            clauses[k].claims = []
        clauses[-1].claims += moved
        stops = [k for k in stops if k not in goal]
        if not stops:
            return
    last = stops[-1]
    for k in stops[:-1]:
        clause = clauses[k]
        if clause.sentence < clauses[last].sentence and any(k < m <= last for m in moves):
            clause.claims = [
                replace(c, kind="reach", place="") if c.kind == "stop" else c
                for c in clause.claims
                if c.kind != "stop" or c.what
            ]
    for clause in clauses:  # the place that is named is where the other stop is
        if any(c.what for k in stops for c in clauses[k].claims if c.kind == "stop"):
            clause.claims = [c for c in clause.claims if c.kind != "stop" or c.what]
    for k in moves:
        then = clauses[k].joint in ("then", "and") and not clauses[last].until
        after = clauses[k].sentence > clauses[last].sentence or (
            then and any(c.kind in ("turn", "leave", "enter") for c in clauses[k].claims)
        )
        told = clauses[k].verb not in ("", "see") or clauses[k].says("left", "right")
        told = told or any(c.kind in ("enter", "leave", "turn") for c in clauses[k].claims)
        if k > last and after and told and not clauses[k].until:
            clauses[k].faults.append("the text goes on after the stop")


def _goal_before_the_way(clauses: list[Clause], stops: list[int], moves: list[int]) -> list[int]:
    """Return the clauses that name the goal before any way is told."""
    if not moves:
        return []
    first = moves[0]
    goal = [
        k
        for k in stops
        if (k < first and clauses[k].tokens[0].text != "stand")
        or (k == stops[0] and clauses[k].sentence == 0 < clauses[first].sentence)
    ]
    return goal if goal and goal[0] < moves[-1] else []


def _announced(clauses: list[Clause], stopped: bool) -> bool:
    """Read the first sentence as the place of the stop, if it announces one."""
    first = [c for c in clauses if c.sentence == clauses[0].sentence]
    rest = clauses[len(first) :]
    cut = next((k for k, c in enumerate(first) if c.joint == ":"), 0)
    head, tail = clauses[:cut], clauses[cut:] if cut else []
    titled = bool(head) and head[0].says("for", "to") and not any(c.has_verb for c in head)
    delivers = bool(head) and head[0].verb == "stop"  # "Deliver the laundry to the kitchen: …"
    if titled or delivers or any(c.says(*_MAY_ANNOUNCE) for c in head):  # "Parcel for the kitchen:"
        first, rest = head, tail
    moves = any(x.kind in ("turn", "leave", "walk") for c in first for x in c.claims)
    own = any(x.kind == "stop" for c in first for x in c.claims)
    toward = any(token.text == "TOWARD" for token in first[0].tokens[:3])
    # "Head for the door, past the sofa" is part of the way.
    way = any(
        x.kind == "pass" or (x.what == "door" and not x.room) for c in first for x in c.claims
    )
    cue = titled or any(c.says(*_ANNOUNCE) for c in first) or (toward and not way)
    if stopped and (moves or not (cue or own)):
        return False
    may = cue or own or any(c.says(*_MAY_ANNOUNCE) for c in first)
    if not rest or not may or (moves and not stopped):
        first, rest = head, tail
    targets = [(c, x) for c in first for x in c.claims
               if (x.name or x.what == "door") and x.kind != "leave"]  # fmt: skip
    if not rest or not targets or any(c.tokens[0].text == "stand" for c in first):
        return False
    for clause in first:
        clause.claims = []
    for clause, claim in targets:
        place = "at"
        if claim.what == "room":
            place = "outside" if clause.says("outside", "before", "short") else "inside"
        if claim.what != "room" or claim.kind != "see" or claim.side or len(targets) == 1:
            rest[-1].claims.append(replace(claim, kind="stop", place=claim.place or place))
    return True


def _stop_where_the_walk_ends(clauses: list[Clause]) -> None:
    """Read the last place that is walked to as the stop of a text that names none."""
    if clauses[-1].until and not clauses[-1].claims:
        clauses[-1].claims = [Claim("stop")]  # "until you are nearly at the wall"
    clause = next((c for c in reversed(clauses) if c.claims), None)
    last = clause and clause.last
    if clause and any(c.metres for c in clause.claims) and not clause.until:
        clause.claims.append(Claim("stop"))
    if clause is None or last is None or not (last.name or last.what == "door"):
        return
    if last.kind == "avoid":  # "if you reach the hall, you have gone too far"
        return
    if clause.until:
        clause.claims = [
            replace(c, kind="stop", place="inside" if c.what == "room" else
                    "past" if c.kind == "pass" else "at")
            if c.name or c.what == "door" else c for c in clause.claims
        ]  # fmt: skip
    elif last.kind == "door" and last.room:  # "the bathroom door is on the right: in you go"
        clause.claims.append(Claim("stop", "room", last.room, place="inside"))
    elif last.kind in ("reach", "enter", "in"):
        place = "inside" if last.what == "room" else "at"
        clause.claims.append(replace(last, kind="stop", place=place, ordinal=0))
