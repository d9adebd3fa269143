"""Whether what a text names leads around a turn that it leaves out."""

import re
from collections.abc import Sequence
from itertools import pairwise

from vlnpe.instruction_gen.facts.records import PathFacts, TurnFact
from vlnpe.instruction_gen.language.lexicon import OBJECT_PHRASES, ROOM_PHRASES
from vlnpe.instruction_gen.language.nouns import answers, room_answers

TURN = re.compile(
    r"\b(?:(?:turn|bear|veer|keep|go|hang an?|make an?|take an?|make another|take another|"
    r"take the next)(?: (?:immediately|immediate|sharply|sharp|slightly|slight|once more))?|"
    r"(?:then|,|and)(?: an?)?) (left|right)\b(?! (?:there|next|after|before|away))",
    re.IGNORECASE,
)
# "Turn right into the kitchen": that room leads round the turn before, too.
_INTO = re.compile(r"(?: into| in| to) [^.,;]*", re.IGNORECASE)
_NAMED = re.compile(
    r"\b(?:"
    + "|".join(sorted(map(re.escape, [*OBJECT_PHRASES, *ROOM_PHRASES]), key=len, reverse=True))
    + r")\b",
    re.IGNORECASE,
)
STOP = re.compile(r"\b(?:stop|wait|halt)", re.IGNORECASE)


def leads_on(rest: str, turns: Sequence[TurnFact], facts: PathFacts) -> bool:
    """Return whether what a text names before the next turn leads around an untold one.

    A room does to which one opening leads from where the turn is made, and so does a thing to stop
    at that is in view there and the only one of its name.
    """
    following = TURN.search(rest)
    if following:
        into = _INTO.match(rest, following.end())
        rest = rest[: into.end() if into else following.start()]
    if re.match(r"\W*(?:and |then )?(?:(?:go|walk) )?(?:around|round|circle|skirt)\b", rest):
        return True  # the way around a thing bends
    stop = STOP.search(rest)
    rooms = [m[0].lower() for m in _NAMED.finditer(rest)]
    things = [m[0].lower() for m in _NAMED.finditer(rest[stop.start() :] if stop else "")]
    return any(
        any(_room_leads_round(turn, word, facts) for word in rooms)
        or any(_thing_leads_round(turn, word, facts) for word in things)
        for turn in turns
    )


def _room_leads_round(turn: TurnFact, word: str, facts: PathFacts) -> bool:
    """Return whether a room that may be called `word` leads around a turn."""
    for visit, following in pairwise(facts.visits):
        inside = visit.from_m - 0.3 <= turn.along_m <= visit.to_m + 0.3
        if inside and visit.exits == 1 and word in room_answers(visit.room):
            return True
        behind = [room for room in visit.beyond if word in room_answers(room)]
        if inside and len(behind) == 1 and word in room_answers(following.room):
            return True
    return False


def _thing_leads_round(turn: TurnFact, word: str, facts: PathFacts) -> bool:
    """Return whether a thing that may be called `word` leads around a turn."""
    seen: dict[float, list[float]] = {}  # from where: which, by where they are passed
    for mark in facts.landmarks:
        if word in answers(mark.noun):
            for m in mark.moments:
                if abs(m.along_m - turn.along_m) <= 1.5 and (m.open or m.pixels >= 12):
                    seen.setdefault(m.along_m, []).append(mark.along_m)
    return any(
        max(places) - min(places) <= 3.0 and max(places) >= turn.along_m - 0.5
        for places in seen.values()
    )
