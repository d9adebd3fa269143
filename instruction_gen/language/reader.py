"""Read the steps and claims of a text, where they are certain; other words stay unchecked."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

from .claims import Claim, Step
from .clauses import Clause, clauses_of, degree_of, part_end, verb_at
from .ending import arrange
from .loose import find_fault, step_of
from .phrases import read_distance, read_phrase, read_side
from .sides import listed_side, place
from .stairs import add_unsaid, is_stairs, look_for_stairs, on_stairs
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
from .tokens import tokenize
from .words import BENDS, NEGATIONS, ORDINALS, PREP_OF, PRONOUNS, RIGHT_ADVERB, SLIGHT

_GOES_ON = frozenset("go turn enter".split())
_OFFSETS = frozenset("past before after from of".split())
_MARKS = frozenset("GO_IN GO_OUT GO_THROUGH".split())
_WAYS = ("from", "into", "through")  # "it's right out of the bathroom" is a turn
_MOST_DOUBTS = 4
_NEAR_M = 1.6
_ROUND = frozenset("around round about".split())
_CLOCK = {"clockwise": "right", "anticlockwise": "left"}
_AROUND = Claim("turn", side="around")
_KEEPS = ("keep", "keeping", "stay", "staying")


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
        self._remember(clause)
        self.sentence.append(clause)
        self.before = clause

    def _remember(self, clause: Clause | None) -> None:
        """Keep what `it` and `go in` mean after a clause."""
        claims = clause.claims if clause else []
        for claim in claims:
            self.stairs |= claim.kind == "climb" or claim.what == "storey" or is_stairs(claim)
            if claim.what == "thing":
                self.thing = claim
            if claim.what in ("door", "room") and claim.kind in ("see", "reach", "pass", "in"):
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
        if PREP_OF.get(clause.tokens[0].text) in _WAYS and not told:
            clause.straight = clause.straight or before.straight  # "straight on and into the hall"
        if not starts:
            return
        last = before.last or Claim("turn")
        same = (last.what == starts[0].what and last.kind != "leave") or last.kind == "pass"
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
        while k < len(tokens):
            word = tokens[k].text
            if (distance := read_distance(tokens, k)) is not None:
                metres, vague, end = distance
                clause.used.update(range(k, end))
                offset = PREP_OF.get(tokens[end].text) if end < len(tokens) else ""
                away = end < len(tokens) and tokens[end].text == "away"
                near = clause.verb == "stop" and metres < _NEAR_M  # "stop a step or two before it"
                offset = away or near or (offset in _OFFSETS and clause.verb != "go")
                if not (clause.negated or offset):
                    claims.append(Claim("walk", metres=metres, vague=vague))
                k = end
            elif (read := read_side(tokens, k)) is not None:
                side_next = self._side(clause, k, *read) or side_next
                k = read[2]
            elif word in _MARKS or word == "TURN_AROUND":
                if word == "TURN_AROUND":
                    claims.append(_AROUND)
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
                at = stop and (clause.verb == "stop" or prep not in _WAYS)
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
                    before = self._said()[-1].claims
                    if (
                        tokens[0].text in ("it", "which", "that")
                        and claim.kind == "see"
                        and claim.what == "room"
                        and before
                        and before[-1].what == "door"
                    ):
                        # "The door is on your right, and it opens on the kitchen."
                        before[-1] = replace(before[-1], room=before[-1].room or claim.name)
                    if claim.kind == "enter" and claims and claims[-1].kind == "door":
                        # "The door on the left into the kitchen" is that of the kitchen.
                        claims[-1] = replace(claims[-1], room=claims[-1].room or claim.name)
                    claims.append(claim)
                k, prep = end, prep if joined else ""
            elif (owner := counted_again(clause, k, self.before)) is not None:
                claims += owner
                clause.used.add(k)
                k += 1
            elif (
                word in PRONOUNS
                and self.thing is not None
                and ((placed := read_side(tokens, k + 1)) and placed[1])
            ):
                kind, place = ("stop", "at") if stop else ("see", "")
                claims.append(replace(self.thing, kind=kind, side="", place=place))
                k += 1
            else:
                if word == "room" and prep in ("into", "from") and not stop and not clause.negated:
                    claims.append(Claim("enter" if prep == "into" else "leave", "room"))
                if word in PREP_OF and not (word == "over" and k + 1 == len(tokens)):
                    prep = clause.prep = preposition(clause, k, stop)
                    prep = "" if prep == "to" and clause.verb == "reach" else prep
                find_fault(clause, k)
                k += 1
        add_unsaid(clause, self.before, self.stairs)
        turns = [c for c in claims if c.kind == "turn"]
        if len({c.side for c in turns}) == 2 and _AROUND in turns:  # "a U-turn to the left"
            claims[:] = [replace(c, degree="sharp") if c in turns else c
                         for c in claims if c != _AROUND]  # fmt: skip
        if side_next:  # of nothing
            clause.used -= {n for n, token in enumerate(tokens) if token.text == side_next}
        if clause.straight and clause.verb == "go" and not claims and not clause.negated:
            claims.append(Claim("walk", side="ahead"))
        stops = [n for n, c in enumerate(claims) if c.kind == "stop"]
        if clause.verb == "stop" and not stops:
            claims.append(stop_at_it(clause, self.before))
        elif stop and len(stops) == 2 and any(claims[n].place == "between" for n in stops):
            for n in stops:
                claims[n] = replace(claims[n], place="between")

    def _side(self, clause: Clause, k: int, side: str, placed: bool, end: int) -> str:
        """Read a side, words `k` to `end`; return it where it is that of the phrase that follows.

        Args:
            placed: `on your left`, not `left`.
        """
        tokens, claims, verb = clause.tokens, clause.claims, clause.verb
        named = [n for n, c in enumerate(claims) if c.what and c.side in ("", "ahead")]
        if (
            named
            and verb == "go"
            and claims[named[-1]].kind == "in"
            and (tokens[k].text == "to" and end == len(tokens))
        ):  # "take the hallway to the left"
            claims.append(Claim("turn", side=side))
            clause.used.update(range(k, end))
            return ""
        before = tokens[k - 1].text if k else ""
        after = tokens[end].text if end < len(tokens) else ""
        alone = not placed and verb in ("", "see", "pass", "stop") and not after
        turned = any(c.kind == "turn" and c != _AROUND for c in claims)
        if not (placed or clause.joint or clause.until) and end - k == len(tokens) \
                and self._is_no_turn():  # fmt: skip
            return ""  # "Right, off we go"
        ahead = side in ("ahead", "behind")
        if named and (
            ahead
            or (alone and k and k - 1 in clause.used and clause.joint != "then")
            or (placed and (verb != "turn" or turned or not clause.has_verb))
        ):
            place(clause, named, side, self.before)
            clause.used.update(range(k, end))
            return ""
        if ahead:
            clause.used.update(range(k, end))
            return side if verb in ("see", "") and not named else ""
        if (
            (not placed and before in ("you", "have", "just", "we"))
            or (not placed and side == "right" and after in RIGHT_ADVERB and verb != "turn"
                and (verb not in ("go", "") or self._is_no_turn()))
            # "The left of the table", "right to the end of the hall".
            or after == "of"
            or (after == "to" and part_end(tokens, end + 1) > end + 1)
        ):  # fmt: skip
            return ""
        if any(t.text in _KEEPS for t in tokens[:k]):
            if named:
                place(clause, named, side, self.before)
                clause.used.update(range(k, end))
            return ""
        seen = verb == "see" and PREP_OF.get(after) not in _WAYS
        if seen or (
            placed and (verb in ("stop", "pass") or (not verb and after and before not in _ROUND))
        ):
            clause.used.update(range(k, end))
            return side
        if verb in ("see", "turn", "go", "", "enter", "leave", "reach") and not clause.negated:
            clause.used.update(range(k, end))
            ordinal = next((ORDINALS[t.text] for t in tokens[max(0, k - 2) : k]
                            if t.text in ORDINALS), 0)  # fmt: skip
            # "Curve around to the left", "bend left round the table": how far is not said.
            words = {t.text for t in tokens}
            bent = words & BENDS and words & _ROUND and not words & SLIGHT
            degree = "" if bent else degree_of(tokens)
            claims.append(Claim("turn", side=side, degree=degree, ordinal=ordinal))
        return ""
