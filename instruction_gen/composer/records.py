"""What the composer mentions of a path."""

from dataclasses import dataclass, replace

from .refer import Reference

PASSES = ("pass", "over", "between")  # how the kinds of what lies along a way begin


@dataclass(frozen=True)
class Event:
    """One thing to mention; its one-letter fields are the slots of `grammar.txt`.

    Attributes:
        kind: a rule of `grammar.txt`.
        along_m: where [m].
        A: room that is left, "" = not mentioned.
        B, C: rooms that are entered, or C another one.
        X, Y, Z: things.
        s, t: sides.
        w: `up` or `down` stairs.
        far_m: how far to walk [m].
        ordinal: of a doorway on its side.
        bent: the way that is told has a bend of its own.
        to_m: where it is done, 0 = at once [m].
    """

    kind: str
    along_m: float
    A: str = ""
    B: str = ""
    C: str = ""
    X: Reference | None = None
    Y: Reference | None = None
    Z: Reference | None = None
    s: str = ""
    t: str = ""
    w: str = ""
    far_m: float = 0.0
    ordinal: int = 0
    bent: bool = False
    to_m: float = 0.0

    @property
    def v(self) -> str:
        """What one does who takes stairs."""
        return {"up": "climb", "down": "descend"}.get(self.w, "")

    @property
    def u(self) -> str:
        """The storey that stairs lead to."""
        return f"{self.w}stairs"

    @property
    def e(self) -> str:
        """The end of stairs that they lead to."""
        return {"up": "top", "down": "bottom"}.get(self.w, "")

    @property
    def done_m(self) -> float:
        """Where it is done [m]."""
        return max(self.along_m, self.to_m)


@dataclass(frozen=True)
class Taste:
    """How much a draft mentions.

    Attributes:
        voice: one of `STYLES`.
        marks: how often a decision is tied to a thing, 0 … 1.
        start: how often the text says where the way starts.
        passed: things passed at most.
        gap_m: a stretch longer than this gets a thing that is passed [m].
        looks: how often a known colour or material is mentioned.
        goal: how often it says first where the way ends.
        more: how often the stop is told by a second thing, the room, or what lies beyond.
        toward: how often a turn is told by what the way then comes to.
        rooms: how often a room that is entered is told by the things in it.
        brief: how often a turn is left out where the name of the next room is enough.
        paced: how often the way to a stop at a thing is told in metres.
    """

    voice: str
    marks: float
    start: float
    passed: int
    gap_m: float
    looks: float
    more: float
    goal: float = 0.0
    toward: float = 0.0
    rooms: float = 0.0
    brief: float = 0.0
    paced: float = 0.0


TASTES = {
    "terse": Taste("terse", 0.15, 0.0, 0, 9.0, 0.0, 0.0, brief=0.7),
    "natural": Taste("natural", 0.4, 0.25, 1, 2.2, 0.7, 0.4, 0.15),
    "rich": Taste("rich", 0.8, 0.5, 4, 1.4, 0.8, 0.8, 0.25, brief=0.4),
}


def explicit(taste: Taste) -> Taste:
    """Return a taste that leaves nothing to guess, for paths where a lighter one misleads."""
    return replace(taste, marks=2.0, passed=taste.passed + 1, gap_m=1.5, more=1.0, brief=0.0,
                   paced=0.6)  # fmt: skip


# What a longer text goes by, of which each text of a path takes another: turns and doors,
# landmarks, or rooms and what stands in them.
PLANS = {
    "turns": {"toward": 0.1, "rooms": 0.1},
    "marks": {"toward": 0.8, "rooms": 0.2, "marks": 1.0},
    "rooms": {"toward": 0.3, "rooms": 0.8},
}
