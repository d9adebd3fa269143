"""What things and rooms are called in one text."""

from collections.abc import Callable

import numpy as np

from ..facts.records import LandmarkFact, PassageFact, PathFacts
from ..language.lexicon import OBJECT_PHRASES
from ..language.nouns import answers, called, spoken
from .grammar import name_of, pick
from .refer import Reference, at_hand, in_row

_SMALL = frozenset(("dumbbell", "vase", "bin", "pouf", "stool", "basket", "box"))
# Adjectives of things whose size [m] lies between two bounds, themselves included.
_SIZES = (
    ("tall", 1.7, np.inf, frozenset(("wardrobe", "bookshelf"))),
    ("large", 1.7, np.inf, frozenset(("sofa", "bed", "table", "desk"))),
    ("big", 1.9, np.inf, frozenset(("sofa", "bed", "table", "rug"))),
    ("long", 1.5, np.inf, frozenset(("bench", "sideboard", "tv stand", "counter"))),
    ("low", 0.0, np.inf, frozenset(("coffee table", "tv stand", "bench"))),
    ("small", 0.0, 0.6, frozenset(("nightstand", "basket", "pouf", "stool", "plant"))),
)
_LONG_M = 2.5
_MOST_ALIKE = 6  # "the desks" among more than so many in a room are nowhere


class Names:
    """What things and rooms are called in one text, and which were mentioned already."""

    def __init__(self, facts: PathFacts, rng: np.random.Generator, looks: float):
        """Start with no names."""
        self.facts, self.rng, self.looks = facts, rng, looks
        self.called: dict[str, str] = {}
        self.names: set[str] = set()
        self.homed = False  # whether the text says in which room it starts
        self.nouns = {"stairs"} if facts.climbs else set[str]()
        self._about = {m.noun for m in facts.landmarks}
        self._noticed = [
            m for m in facts.landmarks
            if m.distance_m <= 3.5 and (m.max_pixels > 60 or m.first_seen_m < 0)
        ]  # fmt: skip

    def name(self, name: str) -> str:
        """Return what a room or a kind of thing is called throughout the text."""
        if name not in self.called:
            self.called[name] = name_of(name, self.rng) if name else ""
        return self.called[name]

    def entered(self, passage: PassageFact) -> str:
        """Return the room entered, told from one of the same kind that is left."""
        room = self.name(passage.to_room)
        upto_m = passage.along_m - 0.1
        storey_m = max((c.to_m for c in self.facts.climbs if c.to_m <= upto_m), default=0.0)
        before = [v for v in self.facts.visits if storey_m <= v.from_m < upto_m]
        if not room or passage.to_room not in [v.room for v in before]:
            return room
        twins = max(v.twins for v in before if v.room == passage.to_room)
        if passage.to_room == "hallway":
            return f"next {room}"
        return f"other {room}" if twins == 1 else f"another {room}"

    def best(
        self,
        near: Callable[[LandmarkFact], float | None],
        *,
        at_goal: bool = False,
        single: bool = False,
    ) -> Reference | None:
        """Return a reference to one of the best things that were not mentioned yet.

        Args:
            near: how far a thing is [m], None if it will not do.
            single: no group of things will do.
        """
        options = []
        for mark in self.facts.landmarks:
            if mark.noun in self.nouns:
                continue
            if (distance_m := near(mark)) is not None:
                reference = self.refer(mark, distance_m, at_goal=at_goal)
                if reference is not None and not (single and reference.plural):
                    options.append((-reference.salience * self.rng.uniform(0.5, 1.5), reference))
        return self.mention(min(options, key=lambda o: o[0])[1]) if options else None

    def refer(
        self, mark: LandmarkFact, distance_m: float, *, at_goal: bool = False
    ) -> Reference | None:
        """Return a name of a thing and perhaps a look; None where another thing might be meant."""
        looks = [word for word in (mark.colour, mark.material, *_sizes(mark)) if word]
        look = pick(looks, self.rng) if looks and self.rng.random() < self.looks else ""
        phrase = self.name(mark.noun)
        if any(called(noun, phrase.lower()) for noun in self._about if noun != mark.noun):
            phrase = mark.noun
        if phrase.lower() not in OBJECT_PHRASES:  # a compound: "conference table"
            phrase = phrase.split()[-1]
        alike = [m for m in self._noticed if m is not mark and mark.noun in answers(m.noun)]
        together = [
            m for m in alike
            if (m.noun, m.room) == (mark.noun, mark.room)
            and (at_hand(m, mark) if at_goal else in_row(m, mark))
        ]  # fmt: skip
        room = [m for m in self.facts.landmarks if m.room == mark.room and m.noun == mark.noun]
        if len(room) > _MOST_ALIKE or (together and at_goal):  # the goal is at one of them
            return None
        if together:
            look = ""
        elif (at_goal and len(room) > 1) or any(mark.room in ("", m.room) for m in alike):
            return None
        words = f"the {look} {spoken(phrase, plural=bool(together))}".replace("  ", " ")
        size = mark.size_m * (0.5 if mark.noun in _SMALL else 1.0)
        long = at_goal and size > _LONG_M  # one may stand anywhere along it
        salience = (
            (0.3 if long else 1.0 if at_goal else size)
            / (0.6 + distance_m)
            / (1.0 + 0.8 * len(alike))
        )
        return Reference(
            mark, spoken(phrase).lower(), words, bool(together),
            salience * (1.0 - 0.6 * mark.occluded),
            look if look == mark.colour else "", look if look == mark.material else "",
        )  # fmt: skip

    def some(self, near: Callable[[LandmarkFact], float | None]) -> Reference | None:
        """Return a thing that is not told from others of its kind: "a window", "pictures"."""
        marks = [m for m in self.facts.landmarks if m.noun not in self.nouns and near(m)]
        if not marks:
            return None
        mark = pick(marks, self.rng)
        several = sum(m.noun == mark.noun for m in marks) > 1
        phrase = spoken(self.name(mark.noun))
        words = spoken(self.name(mark.noun), plural=several)
        return self.mention(Reference(mark, phrase.lower(), f"the {words}", several, 0.0))

    def mention(self, reference: Reference) -> Reference:
        """Remember a thing."""
        self.names.add(reference.mark.name)
        self.nouns.add(reference.mark.noun)
        return reference

    def beside(self, reference: Reference) -> Reference | None:
        """Return the thing that stands right beside another, if it can be named."""
        beside = reference.mark.beside
        other = next((m for m in self.facts.landmarks if m.name == beside and m.nameable), None)
        if reference.plural or other is None or other.noun in self.nouns:
            return None
        result = self.refer(other, other.distance_m)
        return None if result is None or result.plural else self.mention(result)


def _sizes(mark: LandmarkFact) -> list[str]:
    """Return adjectives for the size of a thing."""
    names = {mark.noun, mark.noun.split()[-1]}
    return [
        word
        for word, least_m, most_m, nouns in _SIZES
        if names & nouns and least_m <= mark.size_m <= most_m
    ]
