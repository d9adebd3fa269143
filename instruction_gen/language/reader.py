"""Read the steps and claims of a text, where they are certain; other words stay unchecked."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, pairwise, takewhile

from .claims import Claim, Step
from .clauses import MARKS, Clause, clauses_of, part_end, verb_at
from .ending import arrange
from .loose import find_fault, is_aside, step_of
from .phrases import read_distance, read_phrase, read_side
from .sides import AROUND, STAYS, WAYS, listed_side, side_of
from .stairs import add_unsaid, is_stairs, look_for_stairs, on_stairs
from .tables import closed
from .targets import (
    claim_of,
    counted_again,
    forbidden,
    is_inside,
    marked,
    preposition,
    stop_at,
    stop_at_it,
)
from .tokens import Token, tokenize
from .words import NEGATIONS, ORDINALS, PREP_OF, PRONOUNS, UNITS_M

_GOES_ON = frozenset("go turn enter".split())
_OFFSETS = frozenset("past before after from of".split())
_NAMES = ("see", "reach", "pass", "in", "stop")  # what may be gone into next
_COMES = ("enter", *_NAMES)
_MOST_DOUBTS = 4
_NEAR_M = 1.6
_CIRCLES = closed("goes around")
_CLOCK = {"clockwise": "right", "anticlockwise": "left"}


def read_text(text: str) -> list[Step]:
    """Return the steps of a text in order, the stop last."""
    return next(readings(text))


def readings(text: str) -> Iterator[list[Step]]:
    """Yield the ways to read a text, the likeliest first.

    A word may be a turn, or the side of a thing (`the sofa, left, …`) or an adverb (`go right past
    the sofa`).
    """
    reader, steps = _read(text, frozenset())
    yield steps
    doubts = range(min(reader.doubts, _MOST_DOUBTS))
    for number in range(len(doubts), 0, -1):
        for no_turns in combinations(doubts, number):
            yield _read(text, frozenset(no_turns))[1]


def _read(text: str, no_turns: frozenset[int]) -> "tuple[_Reader, list[Step]]":
    clauses = clauses_of(tokenize(text))
    reader = _Reader(no_turns)
    for clause in clauses:
        reader.read(clause)
        if clause.tokens and is_aside(clause):
            clause.claims, clause.faults, clause.used = [], [], set()
    arrange(clauses)
    return reader, [step_of(clause, text) for clause in clauses if clause.tokens]


class _Reader:
    """Reads clause after clause; what a pronoun means and what a phrase inherits come before."""

    def __init__(self, no_turns: frozenset[int]) -> None:
        self.no_turns = no_turns
        self.doubts = 0  # words so far that may be a turn or not
        self.before: Clause | None = None
        self.sentence: list[Clause] = []  # the clauses before in the same sentence
        self.thing: Claim | None = None  # what `it` means
        self.door: Claim | None = None  # what `go in` means
        self.stairs = False  # the text has spoken of stairs
        self.stopping = -1  # sentence of the stop

    def read(self, clause: Clause) -> None:
        """Fill in a clause."""
        tokens = clause.tokens
        if not tokens:
            return
        verbs = [v for k in range(len(tokens)) if (v := verb_at(tokens, k))]
        strong = [v for v in verbs if v not in ("go", "see")]
        clause.verb = (strong or verbs or [""])[0]
        if clause.verb == "turn":
            tokens[:] = [replace(t, text=_CLOCK.get(t.text, t.text)) for t in tokens]
        clause.negated = clause.says(*NEGATIONS)
        if not verbs and clause.joint in ("and", ",", "or", "then"):
            self._inherit(clause)
        stop = clause.verb == "stop" or (
            self.stopping == clause.sentence
            and (clause.until or clause.verb in ("", "see") or not clause.joint)
            and clause.verb not in ("leave", "cross", "toward")
            and not (clause.joint in ("then", "and", ",") and clause.verb in _GOES_ON)
        )
        if clause.verb == "stop":
            self.stopping = clause.sentence
        if self.before is None or self.before.sentence != clause.sentence:
            self.sentence = []
        if listed_side(clause, self.sentence, self.before, self._is_no_turn):
            self._remember(self.before)
            return
        self._claims(clause, stop)
        if clause.negated:
            last = self.before.claims[-1:] if self.before and clause.says("that") else []
            named = [replace(c, kind="in") for c in last if c.kind in ("see", "pass")]
            clause.claims = forbidden(clause, clause.claims or named)
        else:
            self._forbid_far(clause)
        self._remember(clause)
        self.sentence.append(clause)
        self.before = clause

    def _forbid_far(self, clause: Clause) -> None:
        """Say that a room is not entered: `if you reach the hall, you have gone too far`."""
        before = self.sentence[-1] if self.sentence else clause
        if not (_is_far(before) or _is_far(clause)):
            return
        if _is_far(clause):  # "if you turn left and enter the hall, you've gone too far"
            begun = next((k for k, c in enumerate(self.sentence) if c.until), len(self.sentence))
            before.until |= begun < len(self.sentence)
            for supposed in self.sentence[begun:-1]:
                supposed.claims = []
        for end in (clause, before):
            told = end.last is not None and end.last.what == "room" and end.last.kind in _COMES
            if told and (_is_far(end) or end.until):
                end.claims[-1] = Claim("avoid", "room", end.claims[-1].name)
                break

    def _remember(self, clause: Clause | None) -> None:
        """Keep what `it` and `go in` mean after a clause."""
        claims = clause.claims if clause else []
        for claim in claims:
            self.stairs |= claim.kind == "climb" or claim.what == "storey" or is_stairs(claim)
            if claim.what == "thing":
                self.thing = claim
            if claim.what in ("door", "room") and claim.kind in _NAMES:
                # In "a bedroom door across the hall" the door is meant.
                door, seen = claims[0], claim.kind == "see" and claims[0].what == "door"
                self.door = door if seen and door.room not in ("", claim.name) else claim

    def _is_no_turn(self) -> bool:
        """Return whether the next word in doubt is no turn in this reading."""
        self.doubts += 1
        return self.doubts - 1 in self.no_turns

    def _said(self) -> list[Clause]:
        """Return the clauses before in the same sentence, or the one before it."""
        return self.sentence or [self.before or Clause([])]

    def _inherit(self, clause: Clause) -> None:
        """Give a phrase without a verb that of the clause before: `past the sofa and the table`."""
        starts, before = read_phrase(clause.tokens, 0), self.before
        if before is None or before.sentence != clause.sentence:
            return
        told = clause.says(*ORDINALS, "left", "right")
        if PREP_OF.get(clause.tokens[0].text) in WAYS and not told:
            clause.straight = clause.straight or before.straight  # "straight on and into the hall"
        if not starts:
            return
        last = before.last or Claim("turn")
        taken = starts[0].what == "door" != last.what and clause.says("next", *ORDINALS)
        same = (last.what == starts[0].what and last.kind != "leave") or (
            last.kind == "pass" and not taken  # "past the sofa, next door left"
        )
        if same or before.negated or before.verb in ("stop", "see"):
            placed = any(read_side(clause.tokens, k) for k in range(len(clause.tokens)))
            clause.verb = before.verb
            clause.prep = "" if placed and before.verb == "stop" else before.prep
            clause.until = clause.until or before.until
            clause.negated = clause.negated or before.negated

    def _claims(self, clause: Clause, stop: bool) -> None:
        """Read the claims of a clause from left to right."""
        tokens, claims = clause.tokens, clause.claims
        look_for_stairs(clause)
        prep, side_next, k = clause.prep, "", 0
        if tokens[0].text in _CIRCLES and read_phrase(tokens, 1):
            prep = clause.prep = "around"
        while k < len(tokens):
            word = tokens[k].text
            if (distance := read_distance(tokens, k)) is not None:
                metres, vague, end = distance
                clause.used.update(range(k, end))
                offset = PREP_OF.get(tokens[end].text) if end < len(tokens) else ""
                away = end < len(tokens) and tokens[end].text == "away"
                near = clause.verb == "stop" and metres < _NEAR_M  # "stop a step or two before it"
                # "The sofa is a metre ahead", "three metres in": from it, or from the door.
                placed = end < len(tokens) and (read_side(tokens, end) or ("", False))[1]
                placed = placed and (clause.verb == "see" or any(c.what for c in claims))
                inside = offset == "in" and clause.verb == "stop"
                # "Fifteen metres straight past the sofa", "by the corridor".
                by = offset and tokens[end].text == "by"
                way = clause.verb == "go" or clause.straight or by
                offset = placed or inside or offset in _OFFSETS
                offset = away or near or (offset and not way)
                if not (clause.negated or offset):
                    claims.append(Claim("walk", metres=metres, vague=vague))
                k = end
            elif (read := read_side(tokens, k)) is not None:
                side_next = side_of(clause, k, read, self.before, self._is_no_turn) or side_next
                k = read[2]
            elif word in MARKS or word == "TURN_AROUND":
                if word == "TURN_AROUND":
                    claims.append(AROUND)
                elif not clause.until and not (word == "GO_IN" and is_inside(self._said())):
                    claims.append(marked(word, self.door))  # "as you go in" says only when
                clause.used.add(k)
                k += 1
            elif (part := part_end(tokens, k)) > k:
                k, prep = part, "along" if prep == "to" else prep
            elif (not verb_at(tokens, k) or word == "exit") and (phrase := read_phrase(tokens, k)):
                target, used, end = phrase
                clause.used.update(used)
                if side_next and not target.side:
                    target, side_next = replace(target, side=side_next), ""
                at = stop and (clause.verb == "stop" or prep not in WAYS)
                claim = (stop_at if at else claim_of)(target, prep, clause)
                # "Along the upstairs hallway".
                joined = target.what == "storey" and bool(read_phrase(tokens, end))
                if claim is not None and (target.what == "storey" or is_stairs(target)):
                    claims += on_stairs(target, k, prep, clause, claim, joined)
                elif claim is not None:
                    last = claims[-1] if claims else claim
                    if last.what == "door" and claim.what == "room" and clause.says("is"):
                        # "The second door on the left is that of the bathroom."
                        claims[-1] = replace(last, room=last.room or claim.name, count=0)
                    if (last.kind, last.what, claim.what) == ("see", "room", "door") and (
                        clause.says("is") and not claim.room
                    ):  # "The office is the second door on the left."
                        claims.pop()
                        claim = replace(claim, room=last.name)
                    before = self._said()[-1].claims
                    it = tokens[0].text in ("it", "which", "that")
                    told = (claim.kind, claim.what, *(c.what for c in before[-1:]))
                    if it and told == ("see", "room", "door"):
                        # "The door is on your right, and it opens on the kitchen."
                        before[-1] = replace(before[-1], room=before[-1].room or claim.name)
                    into = claim.what == "room" and prep == "into" and last.what == "door"
                    if into and last.kind in ("door", "stop"):
                        # "The door on the left into the kitchen" is that of the kitchen.
                        claims[-1] = replace(last, room=last.room or claim.name)
                    if not (into and last.kind == "stop"):
                        claims.append(claim)
                k, prep = end, prep if joined else ""
            elif (owner := counted_again(clause, k, self.before)) is not None:
                claims += owner
                clause.used.add(k)
                k += 1
            elif (
                word in PRONOUNS
                and self.thing is not None
                and ((placed := read_side(tokens, k + 1 + _stays(tokens, k + 1))) and placed[1])
            ):
                kind, place = ("stop", "at") if stop else ("see", "")
                claims.append(replace(self.thing, kind=kind, side="", place=place, degree=""))
                k += 1
            else:
                if word == "room" and prep in ("into", "from") and not stop and not clause.negated:
                    claims.append(Claim("enter" if prep == "into" else "leave", "room"))
                if word in PREP_OF and not (word == "over" and k + 1 == len(tokens)):
                    prep = clause.prep = preposition(clause, k, stop)
                    if word == "from" and k and tokens[k - 1].text in UNITS_M:
                        prep = clause.prep = "toward"  # "two metres from the door"
                    prep = "" if prep == "to" and clause.verb == "reach" else prep
                find_fault(clause, k)
                k += 1
        add_unsaid(clause, self.before, self.stairs)
        turns = [c for c in claims if c.kind == "turn"]
        if len({c.side for c in turns}) == 2 and AROUND in turns:  # "a U-turn to the left"
            claims[:] = [replace(c, degree="sharp") if c in turns else c
                         for c in claims if c != AROUND]  # fmt: skip
        if len(turns) == 1 and clause.says("twice"):
            claims.insert(claims.index(turns[0]), turns[0])
        if side_next:  # of nothing
            clause.used -= {n for n, token in enumerate(tokens) if token.text == side_next}
        if clause.straight and clause.verb == "go" and not claims and not clause.negated:
            claims.append(Claim("walk", side="ahead"))
        if clause.straight and clause.verb == "see" and claims and claims[-1].what:
            claims[-1] = replace(claims[-1], side=claims[-1].side or "ahead")
        stops = [n for n, c in enumerate(claims) if c.kind == "stop"]
        if clause.verb == "stop" and not stops:
            claims.append(stop_at_it(clause, self.before))
        elif stop and len(stops) == 2 and any(claims[n].place == "between" for n in stops):
            for n in stops:
                claims[n] = replace(claims[n], place="between")


def _is_far(clause: Clause) -> bool:
    """Return whether it says that something is too far."""
    return ("too", "far") in pairwise(token.text for token in clause.tokens)


def _stays(tokens: Sequence[Token], k: int) -> int:
    """Return how many words at token `k` say that something is or stays: `will be`."""
    return sum(1 for _ in takewhile(lambda token: token.text in STAYS, tokens[k:]))
