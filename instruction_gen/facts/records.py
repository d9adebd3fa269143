"""The facts of one path: everything that a text about it may say."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from ...formats.scene.visibility import SightCamera

FACTS_VERSION = 7
_ONE_TURN_M = 1.3  # bends to one side that are nearer to each other are one turn


@dataclass(frozen=True)
class TurnFact:
    """A change of heading.

    Attributes:
        along_m: distance along the path of its middle [m].
        angle_deg: how far, left is positive [deg].
    """

    along_m: float
    angle_deg: float

    @property
    def side(self) -> str:
        """`left` or `right`."""
        return "left" if self.angle_deg > 0 else "right"


def manoeuvre_deg(turns: Sequence[TurnFact], along_m: float) -> float:
    """Return the angle, without sign, of the bends to one side that make one turn at a place."""
    rows: list[list[TurnFact]] = []
    for turn in turns:
        if (
            rows
            and rows[-1][-1].side == turn.side
            and turn.along_m - rows[-1][-1].along_m <= _ONE_TURN_M
        ):
            rows[-1].append(turn)
        else:
            rows.append([turn])
    off_m = [min(abs(turn.along_m - along_m) for turn in row) for row in rows]
    return sum(abs(turn.angle_deg) for turn in rows[off_m.index(min(off_m))])


@dataclass(frozen=True)
class PassageFact:
    """A step from one room into another.

    Attributes:
        along_m: distance along the path [m].
        from_room, to_room: canonical names, "" when unknown.
        doorway: through a doorway rather than a wider opening without a door.
        bearing_deg: direction to it from a metre and a half before, left is positive [deg].
        side: `left` or `right` of who walks up to it, "" straight ahead.
        ordinal: its place among the doorways on that side, counted from where the room that is
            left was entered; 0 = straight ahead.
        alike: how many other openings of the room that is left lead to rooms of the same name.
        beside: noun of a thing at the opening, the only such one in the room left, "" = none.
    """

    along_m: float
    from_room: str
    to_room: str
    doorway: bool
    bearing_deg: float
    side: str = ""
    ordinal: int = 0
    alike: int = 0
    beside: str = ""


@dataclass(frozen=True)
class ClimbFact:
    """A way over a staircase.

    Attributes:
        along_m, to_m: distances along the path of the first and the last riser [m].
        to_level: of the scene.
        way: `up` or `down`.
        bearing_deg: direction to it from a metre and a half before, left is positive [deg].
        landings_m: from where to where each landing between its flights goes [m].
    """

    along_m: float
    to_m: float
    to_level: int
    way: str
    bearing_deg: float
    landings_m: tuple[tuple[float, float], ...] = ()

    def holds(self, along_m: float) -> bool:
        """Return whether a place of the path is on the staircase [m]."""
        return self.along_m <= along_m <= self.to_m


@dataclass(frozen=True)
class VisitFact:
    """A room along the path; the first is where it starts, the last where it stops.

    Attributes:
        room: canonical name, "" when unknown.
        from_m, to_m: distances along the path [m].
        exits: by how many openings the room can be left; 0 = unknown.
        beyond: names of the rooms behind its openings, one for each, "" when unknown.
        twins: how many other rooms of the level have its name.
        thing: noun of a thing that stands in it and in none of its twins, "" = none.
    """

    room: str
    from_m: float
    to_m: float
    exits: int = 0
    beyond: tuple[str, ...] = ()
    twins: int = 0
    thing: str = ""


@dataclass(frozen=True)
class SightFact:
    """A thing in view from a place.

    Attributes:
        name: of the object in the scene.
        noun: what to call it.
        distance_m: to its nearest edge [m].
        bearing_deg: to its middle from the heading, left is positive [deg].
    """

    name: str
    noun: str
    distance_m: float
    bearing_deg: float


@dataclass(frozen=True)
class ViewFact:
    """What may be seen where a walker decides.

    Attributes:
        point: `start`, `turn`, `door` or `goal`.
        along_m: distance along the path of the start, turn, door or goal [m].
        from_m: where the walker looks from, half a metre before a turn or door [m].
        things: in open view, all around at the start, ahead and beside elsewhere, nearest first.
    """

    point: str
    along_m: float
    from_m: float
    things: tuple[SightFact, ...]


@dataclass(frozen=True)
class Moment:
    """Where a thing is at one place of the path.

    Attributes:
        along_m: distance along the path [m].
        distance_m: to its nearest edge [m].
        bearing_deg: to its nearest edge from the heading, left is positive [deg].
        facing_deg: to its middle [deg].
        open: whether no wall stands between.
        pixels: how many pixels of the camera's image show it; 0 between two looks.
    """

    along_m: float
    distance_m: float
    bearing_deg: float
    facing_deg: float
    open: bool
    pixels: int


@dataclass(frozen=True)
class LandmarkFact:
    """A thing near the path.

    Attributes:
        name: of the object in the scene.
        noun: what to call it, see `language.nouns.noun_of`.
        room: it stands in, "" when unknown.
        colour: as the label says or the pictures show it, "" when neither says clearly.
        material: as the label says, "" when it does not.
        nameable: large and particular enough to steer by, and seen by the camera where one looked.
        count: how many of its noun are near the path.
        ordinal: its place among those, in the order of passing, from 1.
        along_m: where the path is nearest [m].
        distance_m: from the path there [m].
        side: `left`, `right` or "" there.
        goal_distance_m: to its edge from the goal [m].
        goal_bearing_deg: to its edge from the final heading, left is positive [deg].
        goal_open: whether no wall stands between it and the goal.
        first_seen_m, last_seen_m: where the camera first and last shows it [m]; −1 = never.
        max_pixels: in the image that shows it largest.
        occluded: fraction of it that is covered in that image.
        size_m: the larger of breadth and height [m].
        moments: every quarter of a metre, where it is within eight metres.
        leads: of a doorway or opening, the names of the rooms that meet in it.
        beside: object of another noun that stands right beside it, "" = none.
    """

    name: str
    noun: str
    room: str
    colour: str
    material: str
    nameable: bool
    count: int
    ordinal: int
    along_m: float
    distance_m: float
    side: str
    goal_distance_m: float
    goal_bearing_deg: float
    goal_open: bool
    first_seen_m: float
    last_seen_m: float
    max_pixels: int
    occluded: float
    size_m: float
    moments: tuple[Moment, ...] = field(repr=False)
    leads: tuple[str, ...] = ()
    beside: str = ""


@dataclass(frozen=True)
class PathFacts:
    """The facts of one path.

    Distances along it are those in plan, also on stairs.

    Attributes:
        trajectory_id, scene_id: of the episode.
        level: of the scene, where the path starts.
        length_m: of the path in plan [m].
        turns: changes of heading of 20° and more, in order.
        passages: room changes, in order.
        visits: rooms, in order.
        landmarks: things near the path, in the order of passing.
        level_nouns: nouns of all things on the path's levels.
        level_rooms: canonical names of all rooms on the path's levels.
        start_rooms, goal_rooms: other rooms on whose threshold the path starts or stops.
        goal_near_rooms: other rooms that lie openly close to the goal.
        room_ahead: the room that one comes into who walks straight on at the goal, "" = none.
        views: what may be seen at start, turns, doors and goal, in order.
        camera: which looked; None where facts come from the map alone.
        climbs: the staircases that the path takes, in order.
        levels: how many the scene has.
        facts_version: of this record.
    """

    trajectory_id: str
    scene_id: str
    level: int
    length_m: float
    turns: tuple[TurnFact, ...]
    passages: tuple[PassageFact, ...]
    visits: tuple[VisitFact, ...]
    landmarks: tuple[LandmarkFact, ...]
    level_nouns: tuple[str, ...]
    level_rooms: tuple[str, ...]
    start_rooms: tuple[str, ...] = ()
    goal_rooms: tuple[str, ...] = ()
    goal_near_rooms: tuple[str, ...] = ()
    room_ahead: str = ""
    views: tuple[ViewFact, ...] = ()
    camera: SightCamera | None = None
    climbs: tuple[ClimbFact, ...] = ()
    levels: int = 1
    facts_version: int = FACTS_VERSION

    @property
    def goal_room(self) -> str:
        """Where the path stops, "" when unknown."""
        return self.visits[-1].room if self.visits else ""

    @property
    def doors(self) -> list[PassageFact]:
        """The room changes that are no way over stairs."""
        heads = [climb.to_m for climb in self.climbs]
        return [passage for passage in self.passages if passage.along_m not in heads]

    def room_at(self, along_m: float) -> str:
        """Return the room at a place of the path, "" when unknown."""
        return next((v.room for v in self.visits if along_m <= v.to_m), self.goal_room)

    def level_at(self, along_m: float) -> int:
        """Return the level at a place of the path; a staircase belongs to the one it leads from."""
        return next((c.to_level for c in self.climbs[::-1] if along_m >= c.to_m), self.level)

    def on_stairs(self, along_m: float) -> bool:
        """Return whether a place of the path is on a staircase."""
        return any(climb.holds(along_m) for climb in self.climbs)
