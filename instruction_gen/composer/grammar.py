"""The phrases of `grammar.txt`, and the words and claims that one makes of an event."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from ..language.claims import PLACES, SIDES, Claim
from ..language.words import NUMBERS, ORDINALS
from .records import Event
from .refer import Reference

_CHOICE = re.compile(r"\[([^\]]*)\]")
_SLOT, _SHARED = re.compile(r"\{(\w+)\}"), re.compile(r"<(\w+)>")
_BEGUN = re.compile(r"(?<=\. )[a-z]")
_VOICES = {"t": "terse", "n": "natural", "r": "rich"}
_NUMBER = {round(n): w for w, n in reversed(NUMBERS.items()) if n == round(n)}
_ORDINAL = {n: w for w, n in reversed(ORDINALS.items()) if w.isalpha()}
# One walks into a room, but not "in" where there is a hallway.
_INSIDE = re.compile(r"\b(?:(?:go|walk|head|step) in\b|inside|in there|the room)", re.IGNORECASE)
# A way with a bend is not straight.
_STRAIGHT = frozenset(("straight", "forward"))
_NEW_KINDS = ("pass", "cue")  # of several such things it may be "a picture", not "the picture"
_USUAL = 0.35  # how often a thing has its usual name at least
# What goes on ("+", "&") does so with a way, not with what one sees or a room that one enters.
_GOES = (
    "walk", "go", "keep going", "keep walking", "keep moving", "keep straight", "keep to",
    "continue", "head", "carry", "follow", "cut", "cross", "stay", "move", "proceed", "make your",
)  # fmt: skip
_MOVES = ("enter", "leave", "turn", "walk", "climb", "along")
_WAYS = ("follow", "pass", "over", "between")
_TURNS = (
    "turn", "again", "twice", "jog", "slight", "sharp", "leave_turn", "out_turn", "enter_turn",
)  # fmt: skip
# Who sets out has not walked yet.
_MORE = frozenset(("more", "another", "further", "onwards", "continue", "keep", "carry"))
# "Turning left outside, turn right", "past the TV past the sofa": how a phrase begins, and what the
# one before it then does not say.
_TWICE = (("past", "past"), ("turn", "turning"), ("go left", "turning"), ("go right", "turning"),
          *((word, "turning") for word in ("take a", "make a", "hang a")), ("walk", "walking"),
          ("head", "heading"), ("going", "go"), ("walking", "walk"))  # fmt: skip
_AGREES = {"is": ("is", "are"), "it": ("it", "them"), "comes": ("comes", "come")}  # fmt: skip


@dataclass(frozen=True)
class Phrase:
    """A way to say an event.

    Attributes:
        template: with slots and choices.
        joint: how it is joined, see `grammar.txt`; "" = with a joint word.
        voices: that use it.
        claims: each as its words in `grammar.txt`.
    """

    template: str
    joint: str
    voices: frozenset[str]
    claims: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Clause:
    """The words of an event.

    Attributes:
        phrase: what they are made of.
    """

    event: Event
    phrase: Phrase
    words: str

    @property
    def claims(self) -> tuple[Claim, ...]:
        """What the words claim."""
        return tuple(c for form in self.phrase.claims for c in _claims(form, self.event))


def _claims(form: Sequence[str], event: Event) -> list[Claim]:
    """Return a claim, and that of the thing beside its own."""
    claim = _claim(form, event)
    own = [thing for word in form[1:] if isinstance(thing := getattr(event, word, None), Reference)]
    kind, place = ("stop", "at") if claim.kind == "stop" else ("see", "")
    beside = [
        Claim(kind, "thing", o.phrase, place=place, colour=o.colour, material=o.material)
        for thing in own
        if (o := thing.beside)
    ]
    return [claim, *beside]


@cache
def grammar() -> tuple[Mapping[str, Sequence[Phrase]], Mapping[str, Mapping[str, Sequence[str]]]]:
    """Return the phrases of `grammar.txt` by kind of event, and its other parts."""
    text = (files(__package__) / "grammar.txt").read_text(encoding="utf-8")
    rules: dict[str, list[Phrase]] = {}
    parts: dict[str, dict[str, list[str]]] = {"called": {}, "words": {}}
    part, kind, claims = "", "", ()
    for line in text.splitlines():
        if not line.strip() or line.startswith("#"):
            continue
        if line.startswith("%"):
            part = line[1:]
        elif part in parts:
            name, _, ways = line.partition(": ")
            parts[part][name] = ways.split(", " if part == "called" else "|")
        elif " = " in f"{line} ":
            kind, _, spec = (w.strip() for w in f"{line} ".partition(" = "))
            claims = tuple(tuple(claim.split()) for claim in spec.split(";") if claim.strip())
        else:
            voices, _, phrase = line.partition(" ")
            joint, _, rest = phrase.strip().partition(" ")
            joint, rest = (
                (joint, rest) if joint in ("^", "&", "+", "<", ".") else ("", phrase.strip())
            )
            voice = frozenset(_VOICES[v] for v in voices)
            rules.setdefault(kind, []).append(Phrase(rest, joint, voice, claims))
    return rules, parts


def expand(template: str, rng: np.random.Generator) -> str:
    """Return a template with one of each choice and of the words that phrases share."""
    shared = grammar()[1]["words"]
    while "<" in template:
        template = _SHARED.sub(lambda m: pick(shared[m[1]], rng), template)
    return _CHOICE.sub(lambda m: pick(m[1].split("|"), rng), template)


def name_of(noun: str, rng: np.random.Generator) -> str:
    """Return a name for a thing or room in the lexicon, mostly the usual one."""
    names = grammar()[1]["called"].get(noun, (noun,))
    return names[0] if rng.random() < _USUAL else pick(names, rng)


def pick[T](options: Sequence[T], rng: np.random.Generator) -> T:
    """Return one of some options; `rng.choice` takes several times as long."""
    return options[int(rng.integers(len(options)))]


def drafts(
    event: Event, voice: str, rng: np.random.Generator, count: int, before: Clause | None = None
) -> list[Clause]:
    """Return some ways to say an event after the clause before."""
    rule = grammar()[0][event.kind]
    after = before.phrase.joint if before else "."
    onward = along = False
    if before and after not in (".", "^"):
        goes = after in ("&", "+") or _last_sentence(before).startswith(_GOES)
        onward = goes and before.event.kind.startswith(_WAYS)
        along = onward or before.event.kind in _TURNS
    barred = {"&": not along or after == "&", "+": not onward, "^": after == "^",
              "<": after == "^", ".": after == "^"}  # fmt: skip
    fit = [p for p in rule if not barred.get(p.joint)] or rule
    options = [p for p in fit if voice in p.voices] or fit
    fine: list[Clause] = []
    odd: list[Clause] = []
    for _ in range(count):
        phrase = pick(options, rng)
        words = expand(phrase.template, rng)
        new = event.kind.startswith(_NEW_KINDS)
        filled = " ".join(_SLOT.sub(lambda m, new=new: _slot(m[1], event, new), words).split())
        filled = _BEGUN.sub(lambda m: m[0].upper(), filled)
        into_hall = _INSIDE.search(words) and is_hall(event.B)
        straight = event.bent and _STRAIGHT & set(filled.split())
        first = before is None
        again = bool((event.along_m < 0.3 or first) and _MORE & set(filled.split()))
        moved = before is not None and (along or before.event.kind.startswith((*_WAYS, *_MOVES)))
        again |= not moved and filled.startswith("that ")
        said = before.words.split() if before else ()
        twice = filled.count("next ") > 1  # a room without a name is "the next room"
        twice |= any(filled.startswith(begins) and other in said for begins, other in _TWICE)
        clause = Clause(event, phrase, filled)
        (odd if into_hall or straight or again or twice else fine).append(clause)
    return fine or odd


def _last_sentence(clause: Clause) -> str:
    return clause.words.split(". ")[-1].lower()


def is_hall(room: str) -> bool:
    """Return whether a room, as it is called, is a hallway."""
    return room.removeprefix("next ").removeprefix("long ") in grammar()[1]["called"]["hallway"]


def _slot(slot: str, event: Event, new: bool) -> str:
    value = getattr(event, slot[-1], None)
    if slot in _AGREES:
        plural = event.X is not None and (event.X.plural or event.X.phrase.endswith("stairs"))
        return _AGREES[slot][plural]
    if slot == "n":
        return metres(event.far_m)
    if slot == "o":
        return _ORDINAL[event.ordinal]
    if isinstance(value, Reference):
        thing = value.words.removeprefix("the ")
        one = slot[0] == "a" or (new and value.mark.count > 1)
        article = "" if one and value.plural else "the"
        article = ("an" if thing[0] in "aeio" else "a") if one and article else article
        return f"{article} {thing}"
    if slot not in "ABC":
        return str(value)
    return str(value) if str(value).startswith("another") else f"the {value or 'next room'}"


def metres(distance_m: float) -> str:
    """Return about how far, in words: `four metres`."""
    whole = max(1, round(distance_m))
    return f"{_NUMBER.get(whole, str(whole))} metre" + ("" if whole == 1 else "s")


def _claim(form: Sequence[str], event: Event) -> Claim:
    """Return a claim from its words in `grammar.txt`, with the event's slots."""
    kind, *rest = form
    door = kind == "door" or "door" in rest
    said: dict[str, Any] = {"what": "door"} if door else {}
    for word in rest:
        value = getattr(event, word, None)
        if isinstance(value, Reference):
            said |= {"what": "thing", "name": value.phrase}
            said |= {"colour": value.colour, "material": value.material}
        elif word in "ABC":
            room = re.sub("^(?:another|other|next|long) ", "", str(value or ""))
            said |= {"room": room} if door else {"what": "room", "name": room}
        elif word == "o":
            said["ordinal"] = event.ordinal
        elif word == "vague":
            said["vague"] = True
        elif word in ("stairs", "landing", "u"):
            what = {"stairs": "thing", "landing": "room", "u": "storey"}[word]
            said |= {"what": what, "name": str(value or word)}
        elif word in "we":
            said["way" if word == "w" else "place"] = str(value)
        elif word == "n":
            said["metres"] = float(max(1, round(event.far_m)))
        else:
            word = str(value) if word in "st" else word
            field = "side" if word in SIDES else "place" if word in PLACES else "degree"
            said |= {field: word} if word != "door" else {}
    return Claim(kind, **said)
