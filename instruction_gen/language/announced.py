"""Goals that a text says first, before the way to them."""

import re
from dataclasses import replace

from .clauses import Clause, Noun, Parse
from .ending import STATIC, STAYING, last_stop, places

_MOTION = frozenset(("turn", "move", "enter", "leave", "pass"))
_WAY = frozenset("through into along around away from past after".split())
_SENTENCE = re.compile(r"[:;!?]|\.(?!\d)|,? so\b(?! that)|, which means\b")
# What says of a place that the way ends there.
_GOAL = re.compile(
    r"\b(?:goal|aim|destination|target|want|wanted|looking for|bound for|end(?:s|ing)? up"
    r"|(?:you|we)(?: are|'re) after|where (?:to (?:stop|end|be)|(?:you|we|this|it|the \w+)"
    r"(?: \w+)? (?:stop|end|finish|want|need|should|go|head)\w*|this ends)|you should"
    r"|(?:you|we|this|it|way|route|walk)(?: \w+)? ends?"
    r"|(?:your|our|the|last|final) (?:\w+ )?(?:stop|finish|spot|end(?! of)))\b",
    re.IGNORECASE,
)
_NEAR = re.compile(r"\W*right (?:at|by|beside|in|next)\b|.*\binside\b", re.IGNORECASE)
_PURPOSE = re.compile(r"\W*(?:in order )?(?:to|for)\b", re.IGNORECASE)
# "Stop at the bed. Then turn left": an order, given at the wrong place.
_ORDER = re.compile(r"\W*(?:stop|wait|halt|pause|stand)\b", re.IGNORECASE)


def announcement(parse: Parse) -> tuple[int, bool]:
    """Return how many clauses at the beginning may say where the way ends, and whether they do.

    `Your goal is the bed. To get there, …`: the first sentence may, if nothing in it moves but
    towards one thing. It surely does where a word for an end says so.
    """
    begin = next((c.stop for c in parse.clauses if places([c])), 0)
    sentence = _SENTENCE.search(parse.text, begin)
    end = sentence.start() if sentence else len(parse.text)
    first: list[Clause] = []
    for clause in parse.clauses:
        # "The bed: that's the finish."
        beyond = clause.start >= end and not (first and clause.there and not clause.nouns)
        if beyond or (first and _PURPOSE.match(parse.text) and _moving(clause)):
            break
        first.append(clause)
    rest = parse.clauses[len(first) :]
    nouns = places(first)
    if not nouns or not any(map(_moving, rest)) or _ORDER.match(parse.text):
        return 0, False
    stated = any(c.verb in ("see", "stop", "reach") for c in first)
    sure = bool(_GOAL.search(parse.text[: first[-1].stop]))
    leads = first[0].verb == "move" and (nouns[0].prep == "to" or nouns[0].prep in STATIC)
    still = [c for c in first[leads:] if not _moving(c)]
    still += [c for c in first[leads:] if c not in still and _staying(c, parse, stated or sure)]
    if len(still) + leads < len(first) or not (sure or leads or not nouns[0].side):
        return 0, False
    return len(first), (sure and not leads) or any(c.verb == "stop" for c in first)


def _staying(clause: Clause, parse: Parse, stated: bool) -> bool:
    """Return whether a clause that seems to move only places something: `just inside the hall`."""
    begin = max((c.stop for c in parse.clauses if c.stop <= clause.start), default=0)
    near = bool(_NEAR.match(parse.text[begin : clause.stop].lstrip(" ,")))
    return near or (stated and not clause.side and clause.verb not in _MOTION)


def readings(parse: Parse) -> list[Parse]:
    """Return how a text may be meant, a goal that is said first being moved to its end."""
    count, sure = announcement(parse)
    if not count:
        return [parse, *_going_on(parse)]
    meant = _goal_last(parse, count)
    return [meant] if sure else [meant, parse]


def _going_on(parse: Parse) -> list[Parse]:
    """Return the text with a stop that it goes on after as a place: `the rest of the hall, …`."""
    last = last_stop(parse)
    if last is None or not any(map(_moving, parse.clauses[last + 1 :])):
        return []
    if _ORDER.match(parse.text[parse.clauses[last].start :]):
        return []
    passed = replace(parse.clauses[last], verb="", there=False)
    return [replace(parse, clauses=(*parse.clauses[:last], passed, *parse.clauses[last + 1 :]))]


def _goal_last(parse: Parse, count: int) -> Parse:
    # "… until you are there": there is the goal.
    rest = [c for c in parse.clauses[count:] if c.nouns or not (c.verb == "stop" and c.there)]
    named = places(parse.clauses[:count])
    # "It lies behind the second door": that is on the way.
    nouns = [n for n in named if n.kind != "door"] or named[:1]
    at = tuple(replace(n, prep=_placed(n, "with" if k else "near")) for k, n in enumerate(nouns))
    stop = replace(parse.clauses[0], verb="stop", side="", until=False, nouns=at)
    return replace(parse, clauses=(*rest, stop))


def _placed(noun: Noun, otherwise: str) -> str:
    return noun.prep if noun.prep in STAYING - {"after"} else otherwise


def _moving(clause: Clause) -> bool:
    return bool(clause.side) or clause.verb in _MOTION or any(n.prep in _WAY for n in clause.nouns)
