"""Where a text says to stop."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from .clauses import Clause, Noun, Parse

# Prepositions of a place that one is at; the others lead on.
STATIC = frozenset(("near", "at", "before", "between", "in"))
_STAYING = STATIC | {"with", "after", "past"}
_TO = re.compile(r"\b(?:to|as far as)\s+(?:the|a|an|your)\b[^,.;]*$", re.IGNORECASE)
_UNTIL = re.compile(r"\s*,?\s*(?:until|till)\b", re.IGNORECASE)


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
    begin = next((c.stop for c in parse.clauses if _places([c])), 0)
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
    nouns = _places(first)
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
    named = _places(parse.clauses[:count])
    # "It lies behind the second door": that is on the way.
    nouns = [n for n in named if n.kind != "door"] or named[:1]
    at = tuple(replace(n, prep=_placed(n, "with" if k else "near")) for k, n in enumerate(nouns))
    stop = replace(parse.clauses[0], verb="stop", side="", until=False, nouns=at)
    return replace(parse, clauses=(*rest, stop))


def _places(clauses: Sequence[Clause]) -> list[Noun]:
    return [n for c in clauses for n in c.nouns if n.kind in ("object", "room", "door")]


def _placed(noun: Noun, otherwise: str) -> str:
    return noun.prep if noun.prep in _STAYING - {"after"} else otherwise


def _static(clause: Clause, *, first: bool, goal: bool, told: bool) -> bool:
    """Return whether a clause moves nowhere, or, as the first, only to what it names."""
    prep = next((n.prep for n in _places([clause])), "")
    if clause.side or clause.negated or (clause.verb in _MOTION and clause.verb != "move"):
        return False
    if clause.verb == "move":
        return first and (prep == "to" or (told and prep in STATIC))
    way = _INTO if not first else () if goal else _WAY
    return bool(clause.verb) or prep not in way


def _moving(clause: Clause) -> bool:
    return bool(clause.side) or clause.verb in _MOTION or any(n.prep in _WAY for n in clause.nouns)


def last_stop(parse: Parse) -> int | None:
    """Return the index of the clause that says where to stop, or None.

    `Walk on until you are next to the bed.` needs no word for stopping at the end of a text, and
    neither does a last clause that only puts the walker somewhere: `You should be at the bed now.`
    """
    stops = [k for k, c in enumerate(parse.clauses) if c.verb == "stop" and not c.negated]
    if stops:
        return stops[-1]
    end = len(parse.clauses) - 1
    while end >= 0 and parse.clauses[end].negated:  # "…, but do not go in."
        end -= 1
    last = parse.clauses[end] if end >= 0 else None
    if last is None or last.before or len(parse.clauses) < 2:
        return None
    if (end and _arrives(last, parse.clauses[end - 1], parse)) or _settles(last):
        return end
    until = end
    while until > 1 and _there(parse.clauses[until]):  # "until you reach the bed, near the window"
        until -= 1
    if until and _arrives(parse.clauses[until], parse.clauses[until - 1], parse):
        return until
    if _destined(last, parse) or (end < len(parse.clauses) - 1 and _bounded(parse, end)):
        return end
    return _measured(parse, end)


def destination(clause: Clause, parse: Parse) -> bool:
    """Return whether a clause without a word for stopping names where the walk ends."""
    return clause.verb != "stop" and not clause.until and _destined(clause, parse)


def goal_index(clause: Clause) -> int:
    """Return which noun of a clause is where it leads: `to the radiator beneath the window`."""
    k = len(clause.nouns) - 1
    while k > 0 and clause.nouns[k].prep != "to" and clause.nouns[k].prep in _STAYING:
        k -= 1
    return k


def _destined(last: Clause, parse: Parse) -> bool:
    """Whether a clause leads to a place that one stands at: `to the window`, `up to the door`."""
    if not last.nouns or last.verb not in ("", "move", "turn", "pass") or last.until:
        return False
    goal = last.nouns[goal_index(last)]
    place = goal.kind in ("object", "door") or goal.part in ("entrance", "threshold", "mouth")
    said = parse.text[last.start : last.stop]
    return place and goal.prep == "to" and bool(_TO.search(said))


def _bounded(parse: Parse, end: int) -> bool:
    """Whether what must not be entered after clause `end` is where the walk ends."""
    inside = ("into", "through")
    beyond = [
        c for c in parse.clauses[end + 1 :] if c.verb in ("enter", "move") and (
            c.verb == "enter" or any(n.prep in inside for n in c.nouns)
        )
    ]  # fmt: skip
    return bool(beyond) and parse.clauses[end].verb in ("move", "reach", "")


def _measured(parse: Parse, end: int) -> int | None:
    """Return the clause that ends a text by how far to walk, None where none does."""
    static = [c.verb in ("see", "") and not c.side and not c.distance_m for c in parse.clauses]
    while end > 0 and static[end]:  # "The bed is now on your left."
        end -= 1
    for k in range(end, max(-1, end - 2), -1):
        clause = parse.clauses[k]
        if clause.distance_m and clause.verb == "move":
            return k
        if clause.side and not clause.meanwhile:
            return None
    return None


def _there(clause: Clause) -> bool:
    """Whether a clause only says what is where one is."""
    here = all(n.prep in ("", "with") or n.prep in STATIC for n in clause.nouns)
    return here and clause.verb in ("", "see") and not (clause.side or clause.until)


def _arrives(last: Clause, before: Clause, parse: Parse) -> bool:
    """Return whether a clause says until when to walk."""
    if not last.until or not last.nouns:
        return False
    bound = bool(_UNTIL.match(parse.text[last.start :]))
    if not bound and (before.verb in ("turn", "see", "") or before.side):
        return False
    arrives = last.verb in ("", "pass", "reach", "enter")
    return arrives or any(n.prep or n.side for n in last.nouns)


def _settles(last: Clause) -> bool:
    """Return whether the last clause moves nowhere: its verb is unknown, or keeps one there."""
    if last.side:
        return False
    if not _places([last]):
        return last.distance_m > 0 and last.verb == "" and last.unparsed > 0
    if last.verb in ("", "see") and last.unparsed:
        return all(n.prep in _STAYING for n in last.nouns)
    return last.verb == "move" and all(n.prep in ("near", "at", "before") for n in last.nouns)
