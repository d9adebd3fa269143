"""What a clause claims about a target.

Of one that it names the preposition before it and the clause's verb say that; what words that name
nothing refer to is said before: `stop there`, `the second one`, `go in`.
"""

from collections.abc import Sequence
from dataclasses import replace

from .claims import Claim
from .clauses import Clause
from .tables import closed
from .words import ORDINALS, PREP_OF

# Of each kind of target: prepositions, verbs with any preposition, verbs without one, and what is
# claimed. The first row that holds any of them decides; "-" is no verb.
_ROWS = {
    "room": (
        ("from", "", "leave", "leave"),
        ("into to", "", "enter reach", "enter"),
        ("outside", "", "", "see"),
        ("past", "pass", "", "pass"),
        ("with toward at after before behind", "see toward", "", "see"),
        ("in along through across around between", "cross go", "", "in"),
    ),
    "door": (
        ("through into from", "enter leave", "go turn cross -", "door"),
        ("past after", "pass", "", "pass"),
        ("with toward", "see", "", "see"),
    ),
    "thing": (
        ("past along between after across around through", "", "pass cross", "pass"),
        ("with toward from behind before", "see toward", "", "see"),
        ("at to in into", "", "reach", "reach"),
    ),
}
_ROWS |= {"storey": ()}
_ELSE = {"room": "see", "door": "reach", "thing": "see", "storey": "in"}
_FOLLOWS = closed("follows")
_PLACE = {
    "past": "past", "after": "past", "through": "past", "before": "before", "outside": "outside",
    "between": "between", "in": "inside", "into": "inside",
}  # fmt: skip


def claim_of(target: Claim, prep: str, clause: Clause) -> Claim | None:
    """Return what a clause that does not stop claims about a target after a preposition."""
    if clause.before:
        return target
    verb = clause.verb
    kind = _kind(target.what, prep, verb or "-")
    if target.what == "room":
        here = clause.says("are", "am") if prep == "in" else clause.says("this") and not prep
        if (not kind and not verb and not prep) or (verb == "see" and here):
            return replace(target, kind="in")  # "you are in the kitchen", "this is the kitchen"
        # "Until you reach the hall" says where the walker is, not that he enters it there.
        if kind == "enter" and verb != "enter" and (
            clause.until or (verb == "reach" and prep != "into")
        ):  # fmt: skip
            kind = "reach" if clause.until and not target.side else "in"
    elif target.what == "door" and kind == "door" and not prep and clause.until:
        kind = "" if verb not in ("enter", "leave") else kind
    elif target.what == "door" and kind == "door" and target.room and not verb and not prep:
        kind = "see"  # "bathroom door right, kitchen door left"
    target = replace(target, kind=kind or _ELSE[target.what])
    if target.what == "thing" and target.kind == "see" and clause.says(*_FOLLOWS) and not prep:
        return replace(target, degree="slight")  # along the windows, however they lead
    way = target.kind in ("enter", "door", "leave", "in") and target.what in ("room", "door")
    if way and not target.side and clause.is_straight:
        target = replace(target, side="ahead")
    if kind == "pass" and target.what == "thing":
        degree, place = "slight" if prep == "around" else "", prep if prep == "between" else ""
        return replace(target, degree=degree, place=place)
    return target


def _kind(what: str, prep: str, verb: str) -> str:
    for preps, verbs, bare, kind in _ROWS[what]:
        if prep in preps.split() or verb in verbs.split() or (not prep and verb in bare.split()):
            return kind
    return ""


def stop_at(target: Claim, prep: str, clause: Clause) -> Claim:
    """Return the stop of a clause at a target after a preposition."""
    place = _PLACE.get(prep, "at")
    if clause.until:
        place = "past" if clause.verb == "pass" else "before" if clause.before else place
    if target.what == "room":
        reached = clause.until and clause.verb in ("enter", "reach") and place == "at"
        place = "inside" if reached or prep == "along" else place
    elif target.what == "door":
        place = "doorway" if prep == "in" else "past" if place == "past" else "at"
    elif place in ("inside", "outside"):
        place = "at"
    facing = prep == "with" and target.what == "thing" and not target.side
    return replace(target, kind="stop", place=place, side="ahead" if facing else target.side)


def forbidden(clause: Clause, claims: Sequence[Claim]) -> list[Claim]:
    """Return what a negated clause says: rooms that are not entered, stairs that are not taken."""
    kinds = ("enter",) if clause.verb == "turn" else ("enter", "in", "leave", "stop", "door")
    climbs = [replace(c, kind="avoid") for c in claims if c.kind == "climb"]
    return climbs + [
        Claim("avoid", "room", c.room or c.name)
        for c in claims
        if c.kind in kinds
        and (clause.says("GO_IN") and c.room if c.what == "door" else c.what == "room" and c.name)
    ]


def sided(claims: list[Claim], n: int, side: str) -> None:
    """Give claim `n` of a list a side."""
    claims[n] = replace(claims[n], side=side)


def preposition(clause: Clause, k: int, stop: bool) -> str:
    """Return what the preposition at token `k` says of the place that follows."""
    word = clause.tokens[k].text
    if word == "by" and (stop or clause.claims or clause.verb not in ("go", "pass", "cross", "")):
        return "at"
    if word == "in" and clause.verb == "enter":
        return "into"
    almost = word == "to" and k and clause.tokens[k - 1].text in ("nearly", "almost")
    return "toward" if almost else PREP_OF[word]


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
    """Return whether the last that is claimed is that a room is entered, whatever it is like."""
    told = (clause for clause in said if [t.text for t in clause.tokens[:1]] != ["it"])
    claims = [claim for clause in told for claim in clause.claims]
    return bool(claims) and claims[-1].kind in ("enter", "door")


def marked(mark: str, door: Claim | None) -> Claim:
    """Return what `go in`, `go out` and `go through` claim of what was named before."""
    if mark == "GO_OUT":
        return Claim("leave", "room")
    if door is None:
        return Claim("door", "door")
    kind = "enter" if door.what == "room" else "door"
    return Claim(kind, door.what, door.name, door.side, door.ordinal, room=door.room)
