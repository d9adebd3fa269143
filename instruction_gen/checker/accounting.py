"""Whether words and claims that are delivered together say the same.

Every word of a closed class — sides, rooms, things, doors, ordinals, numbers, negation, verbs that
turn, enter, leave, pass or stop — must be said by a claim of its step, and what a claim names must
be in the words. This compares sets of words; what the words say in which order is compared with the
ways in which they can be read.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

from ..language.claims import Claim, Step
from ..language.clauses import verb_at
from ..language.lexicon import OBJECT_PHRASES, OBJECTS, ROOM_PHRASES, ROOMS, noun_kind, singular
from ..language.phrases import read_phrase, read_side
from ..language.reader import readings
from ..language.tokens import Token, tokenize
from ..language.words import (
    NEGATIONS,
    OPENINGS,
    ORDINALS,
    RIGHT_ADVERB,
    UNITS_M,
    VERB_OF,
    is_known,
    number_of,
)
from .said import goal_last

# Which claims account for a verb.
_VERBS = {
    "stop": {"stop"},
    "enter": {"enter", "in", "door", "stop"},
    "leave": {"leave", "door"},
    "pass": {"pass", "see", "stop"},
}
_WAYS = ("walk", "in", "door", "leave", "enter")
_DOORS = frozenset(["door", "doors", "doorway", "doorways", "doorframe"])
_TWICE = ("twice", "two", "double")
_BEFORE_NOUN = ("a", "the", "your", "its", "far", "other", "very", "to", "without", "dead")
_OTHER_ORDER = ("before", "after", "UNTIL", "from", "behind")  # words that turn the order around


def as_worded(step: Step) -> Step:
    """Return a step with what its words, but not its claims, say of the place of a claim.

    "Straight on" is ahead, "an opening" need not be a doorway, what is passed behind the walker or
    after the stop is only seen.
    """
    words = {token.text for token in tokenize(step.words)}
    straight = [c for part in next(readings(step.words)) for c in part.claims if c.side == "ahead"]
    passes = any(VERB_OF.get(word) == "pass" for word in words)
    claims: list[Claim] = []
    for claim in step.claims:
        stopped = claim.side and not passes and any(c.kind == "stop" for c in claims)
        if claim.kind == "pass" and (claim.side in ("ahead", "behind") or stopped):
            claim = replace(claim, kind="see")
        if claim.what == "door":
            claim = replace(
                claim, name="opening" if words & OPENINGS and not words & _DOORS else ""
            )
        same = (c for c in straight if (c.kind, c.what) == (claim.kind, claim.what))
        if (
            claim.kind in _WAYS
            and not claim.side
            and any(_covers(c.name, claim.name) for c in same)
        ):
            claim = replace(claim, side="ahead")
        claims.append(claim)
    return replace(step, claims=tuple(claims))


def accounting_problems(steps: Sequence[Step], text: str) -> list[tuple[int, str]]:
    """Return what words and claims do not share, with the number of the step."""
    problems: list[tuple[int, str]] = []
    said = " ".join(step.words for step in steps)
    if _bare(said) != _bare(text):
        problems.append((len(steps) - 1, "the words of the steps are not those of the text"))
    stopped = False
    named: list[str] = []
    for number, step in enumerate(steps):
        tokens = tokenize(step.words)
        nouns = [t.text for t in tokens if noun_kind(t.text) in ("thing", "room", "storey")]
        problems += [(number, reason) for reason in _uncovered(step, tokens)]
        problems += [(number, reason) for reason in _unsaid(step, [*nouns, *named])]
        # The reading that contradicts the claims least.
        told = min((_contradictions(read, step) for read in readings(step.words)), key=len)
        problems += [(number, reason) for reason in told]
        named += nouns
        if number == 0 and not goal_last(steps)[0].claims:
            continue
        kinds = [c.kind for c in step.claims]
        last = len(kinds) - kinds[::-1].index("stop") if "stop" in kinds else 0
        moves = (set(kinds) if stopped else set(kinds[last:]) if last else set()) - {"stop", "see"}
        if (moves - {"in", "avoid"}) or (stopped and (moves or not kinds)):
            problems.append((number, "the text goes on after the stop"))
        stopped = stopped or "stop" in kinds
    if not stopped:
        problems.append((len(steps) - 1, "no claim says where to stop"))
    return problems


def _bare(text: str) -> list[str]:
    return re.findall(r"[a-z0-9]+", text.lower())


def _uncovered(step: Step, tokens: Sequence[Token]) -> list[str]:
    """Return the words that no claim says."""
    if not step.claims:
        return [f"{step.words!r:.60} claims nothing"]
    kinds = {c.kind for c in step.claims}
    sides = {c.side for c in step.claims}
    numbers = {float(n) for c in step.claims for n in (c.count, c.ordinal, c.metres) if n}
    names = [n for c in step.claims for n in (c.name, c.room) if n]
    doors = any(c.what in ("door", "room") for c in step.claims)
    words = {token.text for token in tokens}
    problems = [f"no word says {side}" for side in ("left", "right")
                if side in sides and side not in words]  # fmt: skip
    for k, token in enumerate(tokens):
        word = token.text
        kind = "" if verb_at(tokens, k) or word in UNITS_M else noun_kind(word)
        verb, number = VERB_OF.get(word, ""), number_of(word)
        if word not in sides and (
            (
                word in ("left", "right")
                and not (word == "right" and _after(tokens, k) in RIGHT_ADVERB)
            )
            or (word == "behind" and (read_side(tokens, k) or ("",))[0] not in {"", *sides})
        ):
            problems.append(f"no claim says {word}")
        elif word in NEGATIONS and "avoid" not in kinds:
            problems.append(f"{word}: an instruction says what to do")
        elif (number and not _vague(tokens, k) and all(abs(number - n) > 0.5 for n in numbers)) or (
            word in ORDINALS and noun_kind(_after(tokens, k)) and ORDINALS[word] not in numbers
        ):
            problems.append(f"no claim says {word}")
        elif kind and not (doors if kind == "door" else any(_covers(n, word) for n in names)):
            bare = kind == "door" and "stop" not in kinds and tokens[k - 1].text == "the"
            if (read_phrase(tokens, k) or kind != "door") and not bare:
                problems.append(f"no claim is about the {word}")
        elif verb in _VERBS and not kinds & _accounts(tokens, k) and not _noun_before(tokens, k):
            problems.append(f"no claim says {word}")
        elif not is_known(word) and not verb_at(tokens, k):
            problems.append(f"{word} is in no table")
    return problems


def _accounts(tokens: Sequence[Token], k: int) -> set[str]:
    """Return the kinds of claims that account for the verb at token `k`."""
    verb, after = VERB_OF[tokens[k].text], read_phrase(tokens, k + 1)
    if verb == "leave" and after and after[0].what == "thing":  # "leaving the plant on your left"
        return _VERBS["pass"]
    standing = tokens[k].text == "stand" and k and tokens[k - 1].text == "you"
    return _VERBS[verb] | ({"in", "see"} if standing else set())


def _unsaid(step: Step, nouns: Sequence[str]) -> list[str]:
    """Return what claims say and no word does; `nouns` may be meant.

    Which room is left or holds a thing need not be said: the facts are asked.
    """
    said = (c for c in step.claims if c.kind != "leave" and c.what != "door")
    names = dict.fromkeys(c.name for c in said if c.name)
    return [f"no word says {n}" for n in names if not any(_covers(n, word) for word in nouns)]


def _contradictions(read: Sequence[Step], step: Step) -> list[str]:
    """Return how the words of a step, read in one way, contradict its claims."""
    problems = [fault for part in read for fault in part.faults]
    claims = [claim for part in read for claim in part.claims]
    # A side belongs to its thing: "the sofa on your left and the table on your right".
    told, meant = ([c.side for c in row if c.kind == "turn"] for row in (claims, step.claims))
    unread = Counter(meant) - Counter(told)  # "go around the bed to the left"
    for claim in claims:
        placed = claim.what == "thing" or (claim.what == "room" and claim.kind in ("see", "pass"))
        if placed and claim.side in ("left", "right") and not unread[claim.side]:
            own = [c for c in step.claims if c.what == claim.what and _covers(c.name, claim.name)]
            if own and not any(c.side == claim.side for c in own):
                problems.append(f"no claim says that the {claim.name} is on the {claim.side}")
    words = [token.text for token in tokenize(step.words)]
    unsaid = set(unread - Counter(words)) - {"around"} and not set(words) & set(_TWICE)
    if (len(told) == len(meant) and told != meant) or unsaid:
        way = ", ".join(told) or "nowhere"
        problems.append(f"the words turn {way}, the claims {', '.join(meant)}")
    ways, climbs = ({c.way for c in row if c.kind == "climb"} for row in (claims, step.claims))
    if bool(ways) != bool(climbs) or (ways - {""} and climbs - {""} and ways != climbs):
        way, own = (", ".join(sorted(row)) or "nowhere" for row in (ways, climbs))
        problems.append(f"the words climb {way}, the claims {own}")
    stops, ends = ([c for c in row if c.kind == "stop" and c.name and c.what != "door"]
                   for row in (claims, step.claims))  # fmt: skip
    for stop in stops:
        if ends and not any(_ends(own, stop) for own in step.claims):
            problems.append(f"no claim stops at the {stop.name}")
    told, meant = (
        [
            singular(c.room if c.what == "door" else c.name)
            for c in row
            if c.kind == "pass" and c.what != "room"
        ]
        for row in (claims, step.claims)
    )
    other = set(words) & set(_OTHER_ORDER)
    if not other and told != meant and sorted(told) == sorted(meant):
        problems.append(f"the words pass {', '.join(told)}, the claims {', '.join(meant)}")
    return problems


def _ends(own: Claim, read: Claim) -> bool:
    """Return whether a claim says what the words say of the stop.

    "In the kitchen by the fridge" may enter the room, "with the bed on your right" see the bed.
    """
    also = "pass" if read.place == "past" else "see" if read.side else ""
    kinds = {"room": ("stop", "enter", "in")}.get(read.what, ("stop", also))
    names = {own.name, own.room if read.what == "room" else ""} - {""}
    return own.kind in kinds and any(_covers(name, read.name) for name in names)


def _after(tokens: Sequence[Token], k: int) -> str:
    return tokens[k + 1].text if k + 1 < len(tokens) else "."


def _noun_before(tokens: Sequence[Token], k: int) -> bool:
    return k > 0 and tokens[k - 1].text in _BEFORE_NOUN


def _vague(tokens: Sequence[Token], k: int) -> bool:
    around = {_after(tokens, k), tokens[k - 1].text if k else ""}
    return tokens[k].text in ("one", "couple", "double", "pair", "half") or bool(
        around & {"of", "or"}
    )


def _covers(name: str, word: str) -> bool:
    """Return whether a claim's name says what a word says: `coffee table` a table, not vice versa.

    A name of several words may also cover one of them: `shoe cabinet` a cabinet.
    """
    means = _meanings(name)
    same = singular(name) == singular(word) or _synonyms(name, word)
    return same or (bool(means) and means <= _meanings(word))


@cache
def _synonyms(name: str, word: str) -> bool:
    both = {singular(name), singular(word)}
    return any(both <= same for same, _ in (*OBJECTS.values(), *ROOMS.values()))


def _meanings(phrase: str) -> frozenset[str]:
    """Return the canonical things and rooms that a phrase may mean."""
    for one in (phrase, singular(phrase)):
        if one in OBJECT_PHRASES or one in ROOM_PHRASES:
            return OBJECT_PHRASES.get(one, frozenset()) | ROOM_PHRASES.get(one, frozenset())
    *_, kind = phrase.split() or [""]
    return _meanings(kind) if kind != phrase else frozenset()
