"""Planted lies: a true text changed so that one thing in it is false.

Texts are changed by patterns over their words, and facts tell whether the result is false; the
checker's grammar has no part in it.
"""

import re
from collections import Counter
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from vlnpe.instruction_gen.facts.records import PathFacts
from vlnpe.instruction_gen.language.lexicon import OBJECT_PHRASES
from vlnpe.instruction_gen.language.nouns import answers

from .leading import STOP, TURN, leads_on

Lie = Callable[[str, PathFacts, np.random.Generator], str | None]

_ABSENT = ("piano", "fireplace", "aquarium", "pool table", "bunk bed", "vending machine")
_OTHER = {"left": "right", "right": "left"}


# "Go right past the sofa" need not be a turn.
_ADVERB = re.compile(r" (?:past|through|by|between|behind|beside)\b", re.IGNORECASE)
_SIDED = re.compile(r"\b(?:on|to) (?:your|the) (left|right)\b(?! of)")
_THING = re.compile(
    r"(?<!o')\b(?:"
    + "|".join(sorted(map(re.escape, OBJECT_PHRASES), key=len, reverse=True))
    + r")(?:e?s)?\b",
    re.IGNORECASE,
)
_ENDS = re.compile(
    r"\b(?:until|once|when)\b[^.,]*\.$|\b(?:metres?|meters?|feet|steps?)\b[^.,]*\.$"
    rf"|\b(?:to|as far as) (?:the|a|your) (?:{_THING.pattern})[^.,]*\.$"
    r"|\b(?:you|where|which)\.$",  # half a sentence
    re.IGNORECASE,
)
# "Your goal is the bed: …" says where to stop, too.
_GOAL_FIRST = re.compile(
    r"[^.:;!?]*\b(?:goal|aim|target|destination|finish\w*|ends?(?! of)|point|place|spot|stop\w*"
    r"|where|wants?|after|headed|bound|make for|going to|reach)\b",
    re.IGNORECASE,
)
_NO_THING = frozenset(["door", "doors", "doorway", "steps", "stairs", "stand", "light"])


def _turns(text: str) -> list[re.Match[str]]:
    """Return where a text says to turn left or right."""
    return [m for m in TURN.finditer(text) if not _ADVERB.match(text, m.end())]


def _things(text: str) -> list[str]:
    """Return the things that a text names, in the singular and in lower case."""
    matches = (m[0].lower() for m in _THING.finditer(text))
    return [w for w in matches if w in OBJECT_PHRASES and w not in _NO_THING]


def wrong_turn(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Swap the side of one stated turn, if no unstated turn to that side makes it true."""
    turns = _turns(text)
    stated = Counter(m[1].lower() for m in turns)
    actual = Counter(t.side for t in facts.turns)
    turns = [m for m in turns if actual[_OTHER[m[1].lower()]] <= stated[_OTHER[m[1].lower()]]]
    return _swapped(text, [turns[int(rng.integers(len(turns)))]]) if turns else None


def skipped_turn(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Drop a clause that states a clear turn and nothing else.

    A turn towards the only door of the first room need not be stated, nor one towards what the
    text names next, see `leads_on`.
    """
    only = bool(facts.passages) and facts.visits[0].exits == 1
    first_m = facts.passages[0].along_m + 0.3 if only else 0.0
    clear = [
        t for t in facts.turns
        if abs(t.angle_deg) >= 60 and first_m <= t.along_m < facts.length_m - 1
    ]  # fmt: skip
    if not clear or len(_turns(text)) > len(clear):
        return None
    for pattern in (
        r",? (?:and )?(?:then )?(?:go|turn|take a|make a|hang a) (?:sharp )?(?:left|right)"
        r"(?: again)?(?=(?:,? and|,? then|[,.]))",
        r"(?<=\. )(?:Turn|Make a|Take a) (?:left|right),? and ",
    ):
        matches = re.search(pattern, text)
        if matches:
            side = "left" if "left" in matches[0].lower() else "right"
            dropped = [t for t in clear if t.side == side]
            rest = text[matches.end() :]
            if not STOP.search(rest):  # where it stops is said first: "Your goal is the bed: …"
                rest += " stop " + re.split(r"[.:;]", text)[0]
            if not dropped or leads_on(rest, dropped, facts):
                return None
            shorter = re.sub(pattern, "", text, count=1)
            return shorter[0].upper() + shorter[1:]
    return None


def wrong_order(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Swap two different turns."""
    for a, b in pairwise(_turns(text)):
        if a[1] != b[1]:
            return _swapped(text, [a, b])
    return None


def off_route(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Name a thing of the level that is nowhere near the path."""
    near = {phrase for m in facts.landmarks for phrase in answers(m.noun)}
    far = [n for n in facts.level_nouns if not answers(n) & near]
    return _renamed(text, far, rng) if far else None


def invented(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Name a thing that does not exist."""
    absent = [n for n in _ABSENT if n not in facts.level_nouns]
    return _renamed(text, absent, rng)


def wrong_side(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Swap the side of a thing that has no like on the other side."""
    options = []
    for match in _SIDED.finditer(text):
        before = text[max(0, match.start() - 45) : match.start()].lower()
        clause = re.split(r"[.,;]|\band\b|\bthen\b", before)[-1]
        named = _things(clause)
        moved = re.search(r"\b(?:turn|go|bear|veer|exit|leave|door|room)\b", clause)
        other = _OTHER[match[1]]
        if named and not moved and not _beside(facts, named[-1], other):
            options.append(match)
    return _swapped(text, [options[int(rng.integers(len(options)))]]) if options else None


def _beside(facts: PathFacts, word: str, side: str) -> bool:
    """Return whether something that may be called `word` is on that side anywhere near the path."""
    sign = 1 if side == "left" else -1
    return any(
        m.distance_m <= 3.2 and m.open and 10 < sign * m.bearing_deg < 170
        for mark in facts.landmarks
        if word in answers(mark.noun)
        for m in mark.moments
    )


def landmark_order(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Swap two things that are passed at least two and a half metres apart."""
    places = {}
    for word in _things(text):
        marks = [m for m in facts.landmarks if word in answers(m.noun)]
        if len(marks) == 1 and len(re.findall(rf"\b{re.escape(word)}\b", text.lower())) == 1:
            places[word] = marks[0].along_m
    names = sorted(places, key=lambda n: places[n])
    if len(names) < 2 or places[names[-1]] - places[names[0]] < 2.5:
        return None
    a, b = names[0], names[-1]
    swapped = re.sub(rf"\b{re.escape(a)}\b", "\0", text, flags=re.IGNORECASE)
    swapped = re.sub(rf"\b{re.escape(b)}\b", a, swapped, flags=re.IGNORECASE)
    return swapped.replace("\0", b)


def distance(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Say a distance longer than the whole path before its stop."""
    metres = round(facts.length_m) + 4
    changed = re.sub(
        r"(?:,? and|,? then|\.)? ?\b(stop|wait)\b", rf", walk {metres} metres and \1", text,
        count=1, flags=re.IGNORECASE,
    )  # fmt: skip
    return changed if changed != text else None


def count(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Say seven where there are fewer."""
    return _renumbered(text, facts, "the seven {}s", 7)


def ordinal(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Say the sixth where there are fewer."""
    return _renumbered(text, facts, "the sixth {}", 6)


def _renumbered(text: str, facts: PathFacts, form: str, number: int) -> str | None:
    for word in _things(text):
        fewer = sum(word in answers(m.noun) for m in facts.landmarks) < number
        pattern = rf"\bthe {re.escape(word)}\b(?!')"
        if fewer and re.search(pattern, text):
            return re.sub(pattern, form.format(word), text, count=1)
    return None


def no_stop(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Leave the stop and all that follows it out.

    What is left must not begin with the goal, nor end with how far to go, until when, or up to
    which thing.
    """
    matches = list(
        re.finditer(r"(?:,? and|,? then|\.|,)? ?\b(?:stop|wait|halt)", text, re.IGNORECASE)
    )
    if not matches or _GOAL_FIRST.match(text[: matches[-1].start()]):
        return None
    shorter = text[: matches[-1].start()].rstrip(" ,.") + "."
    return shorter if len(shorter.split()) >= 6 and not _ENDS.search(shorter) else None


def early_stop(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Stop at a thing that is passed early on."""
    early = [
        m
        for m in facts.landmarks
        if m.nameable and m.count == 1 and m.distance_m < 1.5 and m.goal_distance_m > 4.0
    ]
    if not early:
        return None
    body = re.split(r"(?:,? and|,? then|\.)? ?\b(?:[Ss]top|[Ww]ait)\b", text)[0].rstrip(",. ")
    return f"{body}. Stop next to the {early[0].noun}."


def wrong_language(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Say it in another language."""
    options = (
        "Sortez de la chambre, tournez à gauche dans le couloir et arrêtez-vous près du lit.",
        "Gehen Sie geradeaus durch die Tür, dann links, und halten Sie vor dem Sofa an.",
        "走出卧室，左转进入走廊，在沙发旁边停下来。",
        "बेडरूम से बाहर निकलें, बाएँ मुड़ें और सोफ़े के पास रुकें।",
        "Sal del dormitorio, gira a la derecha en el pasillo y para junto a la mesa.",
    )
    return options[int(rng.integers(len(options)))]


def no_instruction(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Return something other than an instruction."""
    options = (
        "The apartment has a lovely living room with a sofa and a large table in it.",
        "I am sorry, but I cannot help with finding the way to the kitchen and the table.",
        "Where is the sofa, and how do I get into the kitchen from the hallway?",
        'Sure! Here is the instruction you asked for: {"text": "turn left and stop"}',
        "This is a bright room. The bed is next to the window. The door is open.",
    )
    return options[int(rng.integers(len(options)))]


def _swapped(text: str, matches: list[re.Match[str]]) -> str:
    """Return the text with the side of each match changed."""
    for m in sorted(matches, key=lambda m: -m.start(1)):
        text = text[: m.start(1)] + _OTHER[m[1].lower()] + text[m.end(1) :]
    return text


def _renamed(text: str, names: list[str], rng: np.random.Generator) -> str | None:
    """Return the text with one of its things called otherwise."""
    nouns = _things(text)
    if not nouns or not names:
        return None
    old, new = nouns[int(rng.integers(len(nouns)))], names[int(rng.integers(len(names)))]
    changed = re.sub(rf"\b{re.escape(old)}\b", new, text, count=1, flags=re.IGNORECASE)
    return changed if changed != text else None


KINDS: dict[str, Lie] = {
    "turn to the wrong side": wrong_turn,
    "turn skipped": skipped_turn,
    "turns in the wrong order": wrong_order,
    "thing not on the route": off_route,
    "thing on the wrong side": wrong_side,
    "things in the wrong order": landmark_order,
    "false distance": distance,
    "false count": count,
    "false ordinal": ordinal,
    "invented thing": invented,
    "no stop": no_stop,
    "stop in the wrong place": early_stop,
    "wrong language": wrong_language,
    "no instruction": no_instruction,
}
