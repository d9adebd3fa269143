"""What the composer mentions of a path, and how much of it a style mentions."""

from dataclasses import dataclass

from .refer import Reference


@dataclass(frozen=True)
class Step:
    """One thing to mention.

    Attributes:
        kind: `turn`, `leave`, `enter`, `turn_enter`, `enter_turn`, `pass`, `toward`, `between`,
            `follow`, `ahead`, `walk`, `stop`.
        along_m: where [m].
        side: of a turn, or of the thing passed.
        degrees: of a turn, unsigned.
        room: entered or followed; "" = unknown.
        from_room: left.
        doorway: through a doorway.
        other: a second thing (`between`).
        far_m: how far to walk [m].
        bent: the way that this step tells has a bend of its own.
        place: how to stop: `front`, `beside`, `near`, `between`, `inside`, `outside`, `past`,
            `after`.
        covers: Turns that this step describes, as indices into the facts' turns.
    """

    kind: str
    along_m: float
    side: str = ""
    degrees: float = 0.0
    room: str = ""
    from_room: str = ""
    doorway: bool = False
    mark: Reference | None = None
    other: Reference | None = None
    far_m: float = 0.0
    bent: bool = False
    place: str = ""
    covers: tuple[int, ...] = ()


@dataclass(frozen=True)
class Taste:
    """How much a style mentions.

    Attributes:
        gap_m: a stretch longer than this gets a thing that is passed.
        mark_turns: how often a turn is tied to a thing, 0 … 1.
        sides: how often the side of a passed thing is mentioned.
        colours: how often a known colour is mentioned.
        most: things passed at most.
    """

    gap_m: float
    mark_turns: float
    sides: float
    colours: float
    most: int


TASTES = {
    "terse": Taste(4.5, 0.2, 0.3, 0.1, 1),
    "natural": Taste(3.0, 0.35, 0.5, 0.25, 1),
    "rich": Taste(2.0, 0.6, 0.7, 0.5, 2),
}
