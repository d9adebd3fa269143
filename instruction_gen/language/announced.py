"""Goals that a text says first, before the way to them."""

from __future__ import annotations

import re
from dataclasses import replace

from .clauses import Clause, Noun, Parse
from .ending import STATIC, STAYING, places

_MOTION = frozenset(("turn", "move", "enter", "leave", "pass"))
_INTO = frozenset("through into along around away".split())
_WAY = _INTO | {"from", "past", "after"}
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
# "To reach the bed, …", "You're off to the kitchen.", "For the bed, …"
_PURPOSE = re.compile(
    r"\W*(?:(?:in order )?to (?:reach|get|go|find|arrive|come|be)|for (?:the|your|a)"
    r"|(?:you|we)(?:'re| are| need| have| must|'ll| will)(?: \w+)? (?:to|for|be|reach))\b",
    re.IGNORECASE,
)
_YOU = re.compile(r"\byou", re.IGNORECASE)
# "Stop at the bed. Then turn left": an order, given at the wrong place.
_ORDER = re.compile(r"\W*(?:stop|wait|halt|pause|stand)\b", re.IGNORECASE)


def announcement(parse: Parse) -> tuple[int, bool]:
    """Return how many clauses at the beginning may say where the way ends, and whether they do.

    `Your goal is the bed. To get there, …`: the first sentence, as far as nothing in it moves but
    towards one thing. They surely do where a word for an end says so.
    """
    begin = next((c.stop for c in parse.clauses if places([c])), 0)
    sentence = _SENTENCE.search(parse.text, begin)
    end = sentence.start() if sentence else len(parse.text)
    goal = bool(_GOAL.search(parse.text[:end]))
    told = goal or bool(_PURPOSE.match(parse.text))
    count = 0
    for clause in parse.clauses:
        # "The bed: that's the finish."
        beyond = clause.start >= end and not (count and clause.there and not clause.nouns)
        if beyond or not _static(clause, first=not count, goal=goal, told=told):
            break
        count += 1
    first = parse.clauses[:count]
    nouns = places(first)
    on = any(map(_moving, parse.clauses[count:]))
    if not nouns or not on or _ORDER.match(parse.text):
        return 0, False
    said = parse.text[: first[-1].stop]
    if any(c.verb == "stop" for c in first):
        return count, True
    sure = bool(_GOAL.search(said)) and not any(c.verb in _MOTION for c in first)
    # "You have a mirror on your right" is where one starts, "to the hall" may be where one goes on.
    thing = nouns[0].kind == "object" and nouns[0].prep in ("", "to")
    stated = first[0].verb == "see" and not _YOU.search(said)
    named = sure or bool(_PURPOSE.match(said)) or (sentence is not None and sentence[0] == ":")
    return (count, sure) if named or (not nouns[0].side and (thing or stated)) else (0, False)


def readings(parse: Parse) -> list[Parse]:
    """Return how a text may be meant, a goal that is said first being moved to its end."""
    count, sure = announcement(parse)
    if not count:
        return [parse]
    meant = _goal_last(parse, count)
    return [meant] if sure else [meant, parse]


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


def _static(clause: Clause, *, first: bool, goal: bool, told: bool) -> bool:
    """Return whether a clause moves nowhere, or, as the first, only to what it names."""
    prep = next((n.prep for n in places([clause])), "")
    if clause.side or clause.negated or (clause.verb in _MOTION and clause.verb != "move"):
        return False
    if clause.verb == "move":
        return first and (prep == "to" or (told and prep in STATIC))
    way = _INTO if not first else () if goal else _WAY
    return bool(clause.verb) or prep not in way


def _moving(clause: Clause) -> bool:
    return bool(clause.side) or clause.verb in _MOTION or any(n.prep in _WAY for n in clause.nouns)
