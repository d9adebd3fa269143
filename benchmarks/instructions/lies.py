"""Planted lies: a true text changed so that one thing in it is false."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from vlnpe.instruction_gen.facts.records import PathFacts
from vlnpe.instruction_gen.language.lexicon import OBJECT_PHRASES
from vlnpe.instruction_gen.language.nouns import answers, noun_of
from vlnpe.instruction_gen.language.parse import parse

Lie = Callable[[str, PathFacts, np.random.Generator], str | None]

_ABSENT = ("piano", "fireplace", "aquarium", "pool table", "bunk bed", "vending machine")
_OTHER = {"left": "right", "right": "left"}


def wrong_turn(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Swap the side of one told turn."""
    read = parse(text)
    turns = [c for c in read.clauses if c.verb == "turn" and c.side in _OTHER]
    if not turns:
        return None
    clause = turns[int(rng.integers(len(turns)))]
    part = text[clause.start : clause.stop]
    return text[: clause.start] + _swap_first(part) + text[clause.stop :]


def skipped_turn(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Drop a clause that tells a clear turn and nothing else."""
    if not any(abs(t.angle_deg) >= 60 and t.along_m < facts.length_m - 1 for t in facts.turns):
        return None
    for pattern in (
        r",? (?:and )?(?:then )?(?:turn|take a|make a|hang a) (?:sharp )?(?:left|right)"
        r"(?: again)?(?= (?:and|then)|[,.])",
        r"(?<=\. )(?:Turn|Make a|Take a) (?:left|right),? and ",
    ):
        if re.search(pattern, text):
            shorter = re.sub(pattern, "", text, count=1)
            return shorter[0].upper() + shorter[1:]
    return None


def wrong_order(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Swap two different turns."""
    read = parse(text)
    turns = [c for c in read.clauses if c.verb == "turn" and c.side in _OTHER]
    for a, b in pairwise(turns):
        if a.side != b.side:
            first = _swap_first(text[a.start : a.stop])
            second = _swap_first(text[b.start : b.stop])
            return text[: a.start] + first + text[a.stop : b.start] + second + text[b.stop :]
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
    """Swap the side of a thing."""
    found = list(re.finditer(r"\b(?:on|to) (?:your|the) (left|right)\b(?! of)", text))
    read = parse(text)
    sided = [n for c in read.clauses for n in c.nouns if n.kind == "object" and n.side]
    if not found or not sided:
        return None
    match = found[int(rng.integers(len(found)))]
    return text[: match.start(1)] + _OTHER[match[1]] + text[match.end(1) :]


def landmark_order(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Swap two things that are passed at least two and a half metres apart."""
    read = parse(text)
    nouns = [n for c in read.clauses for n in c.nouns if n.kind == "object" and not n.plural]
    places = {}
    for n in nouns:
        marks = [m for m in facts.landmarks if n.head in answers(m.noun)]
        if len(marks) == 1:
            places[n.text] = marks[0].along_m
    names = sorted(places, key=lambda n: places[n])
    if len(names) < 2 or places[names[-1]] - places[names[0]] < 2.5:
        return None
    a, b = names[0], names[-1]
    if min(len(re.findall(rf"\b{x}\b", text.lower())) for x in (a, b)) != 1:
        return None
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
    """Say seven of a thing of which there are fewer."""
    read = parse(text)
    for clause in read.clauses:
        for noun in clause.nouns:
            if noun.kind == "object" and not noun.plural and not noun.colour:
                pattern = rf"\bthe {re.escape(noun.text)}\b"
                if re.search(pattern, text):
                    return re.sub(pattern, f"the seven {noun.text}s", text, count=1)
    return None


def ordinal(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Say the sixth of a thing of which there are fewer."""
    read = parse(text)
    nouns = [n.text for c in read.clauses for n in c.nouns if n.kind == "object" and not n.plural]
    if not nouns:
        return None
    name = nouns[int(rng.integers(len(nouns)))]
    return re.sub(rf"\bthe {re.escape(name)}\b", f"the sixth {name}", text, count=1)


def no_stop(text: str, facts: PathFacts, rng: np.random.Generator) -> str | None:
    """Leave the stop out."""
    shorter = re.sub(r"(?:,? and|,? then|\.)? ?\b(?:stop|wait)\b[^.]*\.?\s*", ". ", text,
                     count=1, flags=re.IGNORECASE)  # fmt: skip
    return shorter.strip() if len(shorter.split()) >= 6 else None


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
    """Something else than an instruction."""
    options = (
        "The apartment has a lovely living room with a sofa and a large table in it.",
        "I am sorry, but I cannot help with finding the way to the kitchen and the table.",
        "Where is the sofa, and how do I get into the kitchen from the hallway?",
        'Sure! Here is the instruction you asked for: {"text": "turn left and stop"}',
        "This is a bright room. The bed is next to the window. The door is open.",
    )
    return options[int(rng.integers(len(options)))]


def _swap_first(part: str) -> str:
    return re.sub(r"\b(left|right)\b", lambda m: _OTHER[m[1].lower()], part, count=1)


def _renamed(text: str, names: list[str], rng: np.random.Generator) -> str | None:
    """The text with one of its things called otherwise."""
    read = parse(text)
    nouns = [n.text for c in read.clauses for n in c.nouns if n.kind == "object"]
    nouns = [n for n in nouns if noun_of(n) or n in OBJECT_PHRASES]
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
