"""Read the steps and claims of a text, where they are certain; other words stay unchecked."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from .claims import Claim, Step
from .phrases import Phrase, is_known, number_of, read_distance, read_phrase, read_side
from .tokens import Token, tokenize
from .words import (
    BENDS,
    DETERMINERS,
    FILLERS,
    JOINTS,
    NEGATIONS,
    ORDINALS,
    PARTS,
    PREP_OF,
    PRONOUNS,
    RIGHT_ADVERB,
    SHARP,
    SLIGHT,
    VERB_OF,
)

_MOVES = frozenset("leave enter door turn pass reach walk avoid".split())
_BREAKS = frozenset(",:—–-()")
_ENDS = frozenset(".!?;")
_GOAL_WORDS = frozenset("destination goal target".split())


@dataclass
class _Clause:
    """Tokens up to the next joint, and what has been read of them."""

    tokens: list[Token]
    until: bool = False
    before: bool = False
    joint: str = ""
    verb: str = ""
    claims: list[Claim] = field(default_factory=list)
    used: set[int] = field(default_factory=set)
    faults: list[str] = field(default_factory=list)
    prep: str = ""
    negated: bool = False
    sentence: int = 0

    @property
    def verb_own(self) -> bool:
        """Whether the clause has a verb of its own."""
        return any(_verb(self.tokens, k) for k in range(len(self.tokens)))


def read_text(text: str) -> list[Step]:
    """Return the steps of a text in order, the stop last."""
    clauses = _clauses(tokenize(text))
    reader = _Reader()
    for clause in clauses:
        reader.read(clause)
    _arrange(clauses)
    return [_step(clause, text) for clause in clauses if clause.tokens]


def _step(clause: _Clause, text: str) -> Step:
    start, stop = clause.tokens[0].start, clause.tokens[-1].stop
    loose = [
        t.text
        for k, t in enumerate(clause.tokens)
        if k not in clause.used and t.is_word and not t.text.isupper() and _is_content(t.text)
    ]
    return Step(text[start:stop], tuple(clause.claims), start, tuple(loose), tuple(clause.faults))


def _is_content(word: str) -> bool:
    """Return whether a word says something that should be covered by a claim."""
    closed = word in ("left", "right") or number_of(word) is not None or word in NEGATIONS
    return closed or not (word == "'s" or any(word in table for table in _SMALL_WORDS))


_SMALL_WORDS = (
    FILLERS, VERB_OF, PREP_OF, DETERMINERS, ORDINALS, PARTS, JOINTS, SLIGHT, SHARP,
)  # fmt: skip


# clauses --------------------------------------------------------------------------------------


def _clauses(tokens: Sequence[Token]) -> list[_Clause]:
    result = [_Clause([])]
    sentence = 0
    for k, token in enumerate(tokens):
        word = token.text
        if word in _ENDS:
            sentence += 1
            result.append(_Clause([], sentence=sentence))
        elif word == "and" and [t.text for t in tokens[k + 1 : k + 3]] == ["a", "half"]:
            result[-1].tokens.append(token)
        elif word in _BREAKS or word in JOINTS:
            if result[-1].tokens or word in JOINTS:
                result.append(_Clause([], joint=word, sentence=sentence))
        elif word == "UNTIL" or (word in ("before", "after") and _begins(tokens, k + 1)):
            result.append(_Clause([], until=True, before=word == "before", sentence=sentence))
        else:
            if _splits(tokens, k, result[-1]):
                result.append(_Clause([], sentence=sentence))
            result[-1].tokens.append(token)
    return result


def _begins(tokens: Sequence[Token], k: int) -> bool:
    """Return whether a clause with a verb of its own begins: `before you reach the sofa`."""
    words = [t.text for t in tokens[k : k + 2]]
    return bool(words) and (words[0] in ("you", "going", "entering", "reaching", "passing", "it"))


def _splits(tokens: Sequence[Token], k: int, clause: _Clause) -> bool:
    """Return whether a second verb begins a clause of its own: `go forward turn left`."""
    kind = _verb(tokens, k)
    if kind in ("turn", "stop", "leave", "enter", "pass") or tokens[k].text == "TURN_AROUND":
        before = [_verb(clause.tokens, j) for j in range(len(clause.tokens))]
        inside = any(v for v in before)
        return inside and not (kind == "pass" and tokens[k].text == "passing" and False)
    return False


def _verb(tokens: Sequence[Token], k: int) -> str:
    """Return the kind of verb at token `k`, "" where the word is none there."""
    word = tokens[k].text
    if word.isupper():
        return {"TURN_AROUND": "turn", "TOWARD": "toward"}.get(word, "")
    kind = VERB_OF.get(word, "")
    if not kind:
        return ""
    before = tokens[k - 1].text if k else ""
    after = tokens[k + 1].text if k + 1 < len(tokens) else ""
    noun = (before in DETERMINERS and before not in ("that", "this", "you", "both", "all")) or (
        before in ORDINALS or before in SLIGHT or before in SHARP
        or before in ("left", "right", "next", "other", "far", "dead", "front", "near")
    )  # fmt: skip
    if noun and kind != "see" and word not in ("leads", "opens"):
        return ""
    if word in PARTS and after == "of":
        return ""
    if word in ("round", "clear", "open", "clean", "water", "set", "bend", "rest", "end") and (
        not after or after in PREP_OF
    ):
        return "" if word not in ("rest", "end", "set") else kind
    if word in ("opens", "open", "leads", "lead", "runs", "goes", "comes", "takes"):
        return "go"
    return kind


# claims ---------------------------------------------------------------------------------------


class _Reader:
    """Reads clause after clause; what a pronoun means and what a phrase inherits come before."""

    def __init__(self) -> None:
        self.before: _Clause | None = None
        self.sentence: list[_Clause] = []  # the clauses before in the same sentence
        self.thing: Claim | None = None  # what `it` means
        self.door: Claim | None = None  # what `go in` means
        self.stopping = -1  # sentence of the stop

    def read(self, clause: _Clause) -> None:
        """Fill in a clause."""
        tokens = clause.tokens
        if not tokens:
            return
        verbs = [v for k in range(len(tokens)) if (v := _verb(tokens, k))]
        strong = [v for v in verbs if v not in ("go", "see")]
        clause.verb = (strong or verbs or [""])[0]
        if clause.verb == "turn" and "stop" in strong:
            clause.verb = "stop"
        clause.negated = any(t.text in NEGATIONS for t in tokens)
        bare = not verbs and clause.joint in ("and", ",", "or", "then")
        starts = read_phrase(tokens, 0)
        before = self.before
        if bare and before is not None and starts and before.sentence == clause.sentence:
            same = bool(before.claims) and (
                before.claims[-1].what == starts[0].what or before.claims[-1].kind == "pass"
            )
            if same or before.verb in ("stop", "see"):
                clause.verb, clause.prep = before.verb, before.prep
                clause.until = clause.until or before.until
                clause.negated = clause.negated or before.negated
        stop = clause.verb == "stop" or (
            self.stopping == clause.sentence
            and (clause.until or clause.verb in ("", "see") or clause.joint == "")
            and clause.verb not in ("stop", "leave", "cross", "toward")
            and not (clause.joint in ("then", "and", ",") and clause.verb in _GOES_ON)
        )
        if clause.verb == "stop":
            self.stopping = clause.sentence
        if not self._listed_side(clause):
            self._claims(clause, stop)
        if clause.negated:
            clause.claims = _avoided(clause.claims)
        self._remember(clause)
        if self.before is None or self.before.sentence != clause.sentence:
            self.sentence = []
        self.sentence.append(clause)
        self.before = clause

    def _listed_side(self, clause: _Clause) -> bool:
        """Give a side that is a clause of its own to what is named before: `…, both on the left`.

        A side alone between commas may as well be a turn: it claims nothing.
        """
        tokens, before = clause.tokens, self.before
        k = next((k for k in range(len(tokens)) if read_side(tokens, k)), -1)
        if k < 0 or before is None or not (clause.joint or clause.until):
            return False
        side, placed, end = read_side(tokens, k) or ("", False, 0)
        rest = [*tokens[:k], *tokens[end:]]
        if any(t.text not in _LISTING and t.text not in _STAYS for t in rest):
            return False
        both = any(t.text in ("both", "all") for t in rest)
        targets = [(c, n) for c in self.sentence for n, x in enumerate(c.claims)
                   if x.what and x.kind != "walk" and not x.side]  # fmt: skip
        if not placed and any(t.text == "again" for t in rest):
            return False
        if before.claims and before.claims[-1].kind in ("door", "leave", "enter") and not placed:
            return False
        if not placed and not both and clause.joint != "(":
            return clause.joint in (",", "-", "–", "—") and bool(before.claims) and bool(
                before.claims[-1].what) and not before.claims[-1].side  # fmt: skip
        if any(t.text in ("two", "three", "one") for t in rest):
            return True  # as many again: what they are is said before
        if not targets or targets[-1][0] is not before:
            stays = any(t.text in _STAYS for t in rest)
            return stays or (placed and bool(before.claims) and bool(before.claims[-1].side))
        for owner, n in targets[-2:] if both else targets[-1:]:
            owner.claims[n] = replace(owner.claims[n], side=side)
        clause.used.update(range(len(tokens)))
        return True

    def _remember(self, clause: _Clause) -> None:
        for claim in clause.claims:
            if claim.what == "thing":
                self.thing = claim
            if claim.what in ("door", "room") and claim.kind in ("see", "reach", "pass", "in"):
                self.door = claim

    def _claims(self, clause: _Clause, stop: bool) -> None:
        tokens, claims = clause.tokens, clause.claims
        prep, side_next, k = clause.prep, "", 0
        degree = _degree(tokens)
        while k < len(tokens):
            word = tokens[k].text
            if (distance := read_distance(tokens, k)) is not None:
                metres, vague, end = distance
                clause.used.update(range(k, end))
                past = end < len(tokens) and PREP_OF.get(tokens[end].text) in _OFFSETS
                if not past and not clause.negated:
                    claims.append(Claim("walk", metres=metres, vague=vague))
                k = end
                continue
            if (sided := read_side(tokens, k)) is not None:
                side, placed, end = sided
                side_next = self._side(clause, k, side, placed, end, degree, side_next) or side_next
                k = end
                continue
            if word in _MARKS:
                self._mark(clause, word, stop)
                clause.used.add(k)
                k += 1
                continue
            if word == "TURN_AROUND":
                claims.append(Claim("turn", side="around"))
                clause.used.add(k)
                k += 1
                continue
            if _of_part(tokens, k):
                while tokens[k].text != "of":
                    k += 1
                k += 1
                continue
            phrase = read_phrase(tokens, k) if not _verb(tokens, k) or word == "exit" else None
            if phrase is not None:
                target, end = phrase
                clause.used.update(target.used)
                if side_next and not target.side:
                    target = replace(target, side=side_next)
                    side_next = ""
                claims += self._emit(clause, target, prep, stop)
                k, prep = end, ""
                clause.prep = prep or clause.prep
                continue
            if word in PRONOUNS and self.thing is not None and self._is_object(tokens, k):
                claims.append(replace(self.thing, kind="see" if not stop else "stop", side="",
                                      place="at" if stop else ""))  # fmt: skip
                k += 1
                continue
            if word == "room" and prep in ("into", "from") and not stop and not clause.negated:
                claims.append(Claim("enter" if prep == "into" else "leave", "room"))
            if word in PREP_OF and not (word == "over" and k + 1 == len(tokens)):
                prep = self._prep(clause, word)
                clause.prep = prep
                if prep == "to" and clause.verb == "reach":
                    prep = ""
            self._unknown(clause, k)
            k += 1
        named = [c for c in claims if c.kind == "stop"]
        if clause.verb == "stop" and not named:
            claims.append(Claim("stop"))
        elif stop and len(named) == 2 and any(c.place == "between" for c in named):
            clause.claims = [replace(c, place="between") if c.kind == "stop" else c for c in claims]
        if clause.verb == "turn" and not any(c.kind == "turn" for c in claims):
            pass

    def _is_object(self, tokens: Sequence[Token], k: int) -> bool:
        """Return whether a pronoun stands for a thing on a side: `keep it on your left`."""
        sided = read_side(tokens, k + 1)
        return sided is not None and sided[1]

    def _prep(self, clause: _Clause, word: str) -> str:
        prep = PREP_OF[word]
        if word == "by" and (clause.verb not in ("go", "pass", "cross", "") or clause.claims):
            return "at"
        return prep

    def _side(
        self, clause: _Clause, k: int, side: str, placed: bool, end: int, degree: str, pending: str
    ) -> str:
        """Handle a side; return it where it is one of the phrase that follows."""
        tokens, claims = clause.tokens, clause.claims
        words = range(k, end)
        named = [n for n, c in enumerate(claims) if c.what and c.kind != "walk" and not c.side]
        lone = not placed and clause.verb in ("", "see", "pass") and end == len(tokens)
        if not placed and clause.joint == "(" and len(words) == len(tokens):
            before = self.before.claims if self.before is not None else []
            if before and before[-1].what:
                before[-1] = replace(before[-1], side=side)
                clause.used.update(words)
            return ""
        if lone and named and k and k - 1 in clause.used and clause.joint != "then":
            self._place(clause, named, side)
            clause.used.update(words)
            return ""
        keeping = any(t.text in ("keep", "keeping", "stay", "staying") for t in tokens[:k])
        if side in ("ahead", "behind"):
            if named:
                claims[named[-1]] = replace(claims[named[-1]], side=side)
            clause.used.update(words)
            return "" if named else (side if clause.verb in ("see", "") else "")
        turning = clause.verb == "turn" or (
            clause.verb in ("go", "", "enter", "leave", "reach") and not (placed and named)
        )
        after = tokens[end].text if end < len(tokens) else ""
        turned = any(c.kind == "turn" for c in claims)
        if placed and named and (clause.verb != "turn" or turned or not clause.verb_own):
            self._place(clause, named, side)
            clause.used.update(words)
            return ""
        if not placed and k and tokens[k - 1].text in ("you", "have", "just", "we"):
            return ""
        if not placed and side == "right" and after in RIGHT_ADVERB and clause.verb != "turn":
            return ""
        if after == "of" or (after == "to" and _of_part(tokens, end + 1)):
            return ""  # "the left of the table", "right to the end of the hall"
        if keeping:
            if named:
                self._place(clause, named, side)
                clause.used.update(words)
            return ""
        if clause.verb == "see" or (placed and not clause.verb and end < len(tokens)):
            clause.used.update(words)
            return side
        if (placed and clause.verb == "stop") or (placed and clause.verb == "pass"):
            clause.used.update(words)
            return side
        if turning and not clause.negated:
            clause.used.update(words)
            ordinal = next((ORDINALS[t.text] for t in tokens[max(0, k - 2) : k]
                            if t.text in ORDINALS), 0)  # fmt: skip
            claims.append(Claim("turn", side=side, degree=degree, ordinal=ordinal))
        return ""

    def _place(self, clause: _Clause, named: list[int], side: str) -> None:
        """Give a side to the last target, and to those that are listed with it."""
        claims = clause.claims
        claims[named[-1]] = replace(claims[named[-1]], side=side)
        before = self.before
        if clause.joint == "and" and before is not None and len(named) == 1 and not clause.verb_own:
            for n, c in enumerate(before.claims):
                if n == len(before.claims) - 1 and c.what == claims[named[-1]].what and not c.side:
                    before.claims[n] = replace(c, side=side)

    def _mark(self, clause: _Clause, mark: str, stop: bool) -> None:
        door = self.door
        if mark == "GO_OUT":
            clause.claims.append(Claim("leave", "room"))
        elif door is None:
            clause.claims.append(Claim("door", "door"))
        elif door.what == "room":
            clause.claims.append(Claim("enter", "room", door.name, door.side, door.ordinal))
        else:
            clause.claims.append(
                Claim("door", "door", side=door.side, ordinal=door.ordinal, room=door.room)
            )

    def _emit(self, clause: _Clause, target: Phrase, prep: str, stop: bool) -> list[Claim]:
        """Return the claims of one target after a preposition."""
        verb = clause.verb
        if (stop and prep not in ("through", "from", "into")) or (stop and verb == "stop"):
            return _stopped(target, prep, clause)
        if clause.before:
            return [target.claim("see")]
        maker = {"room": _room, "door": _door, "thing": _thing}[target.what]
        claim = maker(target, prep, verb, clause)
        return [claim] if claim is not None else []

    def _unknown(self, clause: _Clause, k: int) -> None:
        """Find fault with a word that stands for a thing and is in no table."""
        word = clause.tokens[k].text
        if is_known(word) or not word.isalpha():
            if is_known(word) and not (word in ("left", "right") or number_of(word) is not None
                                       or word in NEGATIONS):  # fmt: skip
                clause.used.add(k)
            return
        before = clause.tokens[k - 1].text if k else ""
        after = clause.tokens[k + 1].text if k + 1 < len(clause.tokens) else ""
        adjective = word.endswith(_ADJECTIVE)
        if read_phrase(clause.tokens, k + 1) and after not in PREP_OF and not adjective \
                and after not in DETERMINERS:  # fmt: skip
            clause.faults.append(f"{word} {after}: no such thing is known")
        elif before in DETERMINERS and not adjective and before not in ("that", "this"):
            clause.faults.append(f"{word}: no such thing or place is known")


# "The table, which stays on your right": no way of the walker.
_STAYS = frozenset(
    "stay stays staying lie lies lying is are remain remains being keep keeping keeps be will "
    "should".split()
)
_LISTING = frozenset(
    "both all again also each too a bit little just slightly now directly immediately again off "
    "over still as before always and ahead straight further back well two three one which that it "
    "them".split()
)
_GOES_ON = frozenset("go turn enter".split())
_ADJECTIVE = (
    "y", "ed", "ing", "ful", "ous", "ive", "al", "less", "ish", "en", "ern", "ic", "ly", "est",
    "ible", "able",
)  # fmt: skip
_OFFSETS = frozenset("past before after from of".split())
_MARKS = frozenset("GO_IN GO_OUT GO_THROUGH".split())


def _of_part(tokens: Sequence[Token], k: int) -> bool:
    """Return whether a part begins that stands for what follows: `the end of the sofa`."""
    if tokens[k].text == "PLACE_OF":
        return False
    j = k
    while j < len(tokens) and (tokens[j].text in DETERMINERS or tokens[j].text in _PART_WORDS):
        j += 1
    return j < len(tokens) and tokens[j].text in PARTS and (
        j + 1 < len(tokens) and tokens[j + 1].text == "of"
    )  # fmt: skip


_PART_WORDS = frozenset(
    "far near other opposite long short left right first second very front back whole same "
    "further closest nearest".split()
)


def _degree(tokens: Sequence[Token]) -> str:
    words = {t.text for t in tokens}
    if words & SHARP:
        return "sharp"
    return "slight" if words & SLIGHT or words & BENDS else ""


def _room(target: Phrase, prep: str, verb: str, clause: _Clause) -> Claim | None:
    if prep == "from" or (verb == "leave" and not prep):
        return target.claim("leave")
    if prep in ("into", "to") or (verb in ("enter", "reach") and not prep):
        at = clause.until or (verb == "reach" and prep != "into")
        return target.claim("in" if at and verb != "enter" else "enter")
    if prep == "outside":
        return target.claim("see")
    if (
        verb == "see"
        or prep in ("past", "with", "toward", "at", "after", "before", "behind")
        or (verb in ("pass", "toward"))
    ):
        return target.claim("pass" if prep == "past" or verb == "pass" else "see")
    if prep in ("in", "along", "through", "across", "around", "between") or verb in ("cross", "go"):
        return target.claim("in")
    return target.claim("see") if verb or prep else None


def _door(target: Phrase, prep: str, verb: str, clause: _Clause) -> Claim | None:
    if (
        prep in ("through", "into", "from")
        or verb in ("enter", "leave")
        or (not prep and verb in ("go", "turn", "cross", "") and not clause.until)
    ):
        return target.claim("door")
    if prep == "past" or verb == "pass":
        return target.claim("pass")
    return target.claim("see" if verb == "see" or prep in ("with", "toward") else "reach")


def _thing(target: Phrase, prep: str, verb: str, clause: _Clause) -> Claim | None:
    if prep in ("past", "along", "between", "after", "across", "around", "through") or (
        verb in ("pass", "cross") and not prep
    ):
        return target.claim("pass", degree="slight" if prep == "around" else "")
    if prep in ("with", "toward", "from", "behind", "before") or verb in ("see", "toward"):
        return target.claim("see")
    if prep in ("at", "to", "in", "into", "of"):
        return target.claim("reach" if prep != "of" else "see")
    return target.claim("pass" if not verb and clause.prep == "past" else "see")


def _stopped(target: Phrase, prep: str, clause: _Clause) -> list[Claim]:
    place = {
        "past": "past", "after": "past", "before": "before", "outside": "outside",
        "between": "between", "in": "inside", "into": "inside", "through": "past",
    }.get(prep, "at")  # fmt: skip
    if clause.until and clause.verb == "pass":
        place = "past"
    if clause.before and clause.until:
        place = "before"
    if target.what == "room":
        reached = clause.until and clause.verb in ("enter", "reach") and place == "at"
        if reached or prep == "along":
            place = "inside"
        if clause.verb == "leave":
            return []
        if place == "past":
            return [target.claim("see")]
    if target.what == "door":
        place = "doorway" if prep == "in" else "past" if place == "past" else "at"
    if target.what == "thing" and place in ("inside", "outside"):
        place = "at"
    return [target.claim("stop", place=place)]


def _avoided(claims: Sequence[Claim]) -> list[Claim]:
    """Return what a negated clause says: rooms that are not entered."""
    return [
        Claim("avoid", "room", c.name)
        for c in claims
        if c.what == "room" and c.kind in ("enter", "in", "leave", "stop", "door") and c.name
    ]


# the whole text -------------------------------------------------------------------------------


def _arrange(clauses: list[_Clause]) -> None:
    """Put what is named with a turn before it, and the stop at the end."""
    for k, clause in enumerate(clauses):
        turns = [n for n, c in enumerate(clause.claims) if c.kind == "turn"]
        if turns:
            n = turns[0]
            marks = [c for c in clause.claims[n + 1 :] if c.kind in ("reach", "see")
                     and c.what in ("thing", "door")]  # fmt: skip
            rest = [c for c in clause.claims[n:] if c not in marks]
            if len(rest) > 1 and rest[1].kind in ("enter", "door") and not rest[1].side \
                    and rest[0].side in ("left", "right"):  # fmt: skip
                rest[1] = replace(rest[1], side=rest[0].side)  # "turn left into the kitchen"
            clause.claims = [*clause.claims[:n], *marks, *rest]
        # "Turn left when you reach the sofa": the sofa comes first.
        before = clauses[k - 1] if k else None
        if (
            clause.until and before is not None and clause.claims and before.verb == "turn"
            and before.claims and clause.joint == "" and before.sentence == clause.sentence
            and all(c.kind in ("see", "reach", "in", "pass") for c in clause.claims)
        ):  # fmt: skip
            before.claims, clause.claims = clause.claims + before.claims, []
    _stops(clauses)


def _stops(clauses: list[_Clause]) -> None:
    """Judge where the text stops: one stop, after which nothing moves."""
    stops = [k for k, c in enumerate(clauses) if any(x.kind == "stop" for x in c.claims)]
    moves = [k for k, c in enumerate(clauses) if any(x.kind in _MOVES and x.kind != "avoid"
                                                     for x in c.claims)]  # fmt: skip
    announced = _goal_first(clauses, bool(stops))
    if not stops:
        if not announced:
            _end_of_walk(clauses)
        return
    if announced:
        moves = [k for k in moves if clauses[k].claims]
        stops = [k for k in stops if clauses[k].claims]
    first_move = moves[0] if moves else len(clauses)
    goal = [k for k in stops if (clauses[k].tokens and clauses[k].tokens[0].text != "stand"
            and k < first_move) or (clauses[k].sentence == 0 and k == stops[0]
            and clauses[k].sentence < clauses[first_move].sentence)]  # fmt: skip
    if goal and moves and goal[0] < moves[-1]:
        # The goal is said first.
        moved = [c for k in goal for c in clauses[k].claims]
        for k in goal:
            clauses[k].claims = []
        clauses.append(_Clause([]))
        last = next(c for c in reversed(clauses) if c.tokens)
        last.claims = [*last.claims, *moved]
        stops = [k for k in stops if k not in goal]
    if not stops:
        return
    last = stops[-1]
    for k in stops:
        if k != last and clauses[k].tokens[0].text == "stand" and not any(m < k for m in moves):
            clauses[k].claims = []  # how the walker stands at the start
    for k in stops[:-1]:
        if (
            any(k < m <= last for m in moves if m != k)
            and clauses[k].sentence < clauses[last].sentence
        ):
            clauses[k].claims = [
                replace(c, kind="reach", place="") if c.kind == "stop" else c
                for c in clauses[k].claims
                if c.kind != "stop" or c.what
            ]
    for k in moves:
        if k > last and clauses[k].sentence > clauses[last].sentence:
            clauses[k].faults.append("the text goes on after the stop")


_GOAL_CUES = frozenset(
    "aim goal target destination finish finishes ends yourself place spot point want wants after "
    "headed bound TOWARD find stop".split()
)


_ANNOUNCED = frozenset(
    "aim goal target destination finish finishes ends place spot point headed bound TOWARD "
    "stop".split()
)


def _goal_first(clauses: list[_Clause], stopped: bool) -> bool:
    """Read the first sentence as the place of the stop, if it announces one."""
    first = [c for c in clauses if c.sentence == clauses[0].sentence]
    rest = [c for c in clauses if c not in first and c.tokens]
    cut, after = _until_colon(first, clauses)
    if cut and any(t.text in _GOAL_CUES for c in cut for t in c.tokens):
        first, rest = cut, after
    words = {t.text for c in first for t in c.tokens}
    if any(x.kind == "stop" for c in first for x in c.claims):
        words.add("stop")
    moves = any(x.kind in ("turn", "leave", "walk") for c in first for x in c.claims)
    if stopped and (not words & _ANNOUNCED or moves):
        return False
    if not rest or not words & _GOAL_CUES or (moves and not stopped):
        first, rest = cut, after
    if any(t.text == "stand" for c in first for t in c.tokens[:1]):
        return False
    targets = [(c, x) for c in first for x in c.claims if x.name or x.what == "door"]
    if not rest or not targets:
        return False
    for clause in first:
        clause.claims = []
    last = rest[-1]
    for clause, claim in targets:
        place = "inside" if claim.what == "room" else "at"
        if claim.what == "room" and any(
            t.text in ("outside", "before", "short") for t in clause.tokens
        ):
            place = "outside"
        if claim.kind != "see" or claim.side or len(targets) == 1 or claim.what != "room":
            stop = replace(claim, kind="stop", place=claim.place or place)
            last.claims = [*last.claims, stop]
    return True


def _until_colon(
    first: list[_Clause], clauses: list[_Clause]
) -> tuple[list[_Clause], list[_Clause]]:
    """Return the clauses before and after a colon in the first sentence."""
    cut = next((k for k, c in enumerate(clauses) if c.joint == ":" and c in first), None)
    if cut is None:
        return [], []
    return clauses[:cut], [c for c in clauses[cut:] if c.tokens]


def _end_of_walk(clauses: list[_Clause]) -> None:
    """Read the last place that is walked to as the stop of a text that names none."""
    for clause in reversed(clauses):
        if not clause.claims:
            continue
        last = clause.claims[-1]
        if clause.until and last.name:
            clause.claims = [
                replace(c, kind="stop", place="inside" if c.what == "room" else
                        "past" if c.kind == "pass" else "at")
                if c.name else c for c in clause.claims
            ]  # fmt: skip
            return
        if last.kind in ("reach", "enter", "in") and last.name:
            place = "inside" if last.what == "room" else "at"
            clause.claims.append(replace(last, kind="stop", place=place, ordinal=0))
        return
