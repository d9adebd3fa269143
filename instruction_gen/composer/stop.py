"""Choose how to say where a path stops."""

from dataclasses import replace

import numpy as np

from ..facts.doors import DOOR, OPENING
from ..facts.records import PathFacts
from .grammar import pick
from .names import Names
from .records import Event, Taste
from .refer import STOP_AT_M, Reference, at_goal, hung_at_goal, in_view, moment_at, passed

_JUST_INSIDE_M, _STEPS_INSIDE_M = 1.25, 2.0
_PAST_M, _BEHIND_DEG = 1.2, 100.0
_IN_DOORWAY_M, _IN_FRAME_M = 0.5, 0.3
_BESIDE_M = 1.1
_COMES_M = 1.0
_AT_STAIRS_M = 0.8
_AT_DOOR_M, _AHEAD_M = 1.4, 4.0
_BEFORE_DEG, _OUTSIDE_DEG = 60.0, 105.0


def stop_events(facts: PathFacts, names: Names, taste: Taste) -> list[Event]:
    """Return the stop, and perhaps what shows that one went too far."""
    stop = _stop(facts, names, taste)
    visited = {v.room for v in facts.visits}
    beyond = facts.room_ahead
    last = [stop]
    new = beyond and beyond not in visited and beyond not in facts.goal_rooms
    if new and not stop.B and names.rng.random() < taste.more:
        last.append(Event("too_far", facts.length_m, C=names.name(beyond)))
    return last


def _stop(facts: PathFacts, names: Names, taste: Taste) -> Event:
    length, visits = facts.length_m, facts.visits
    if _stops_in_doorway(facts):
        # What is ahead lies in the next room, which the path does not enter.
        return Event("stop_doorway", length, C=names.name(facts.goal_rooms[0]))
    since_door_m = _since_door_m(facts)
    if since_door_m <= _IN_FRAME_M and facts.passages[-1].doorway:
        return Event("stop_doorway", length, C=names.entered(facts.passages[-1]))
    mark = names.best(lambda m: m.goal_distance_m if at_goal(m, facts) else None, at_goal=True)
    if mark is not None:
        return _at(mark, facts, names, taste)
    climb = facts.climbs[-1] if facts.climbs else None
    if climb and length - climb.to_m <= _AT_STAIRS_M:
        return Event("stop_stairs", length, w=climb.way)
    if since_door_m <= _JUST_INSIDE_M:
        return Event("stop_here", length, B=names.entered(facts.passages[-1]))
    near = facts.goal_near_rooms
    alone = len(near) == 1 and visits[-1].beyond.count(near[0]) <= 1
    if since_door_m > _STEPS_INSIDE_M and alone and near[0] not in (v.room for v in visits):
        off_deg = _off_deg(near[0], facts)
        if off_deg <= _OUTSIDE_DEG:  # who has left the door behind stops past it
            kind = "stop_before" if off_deg <= _BEFORE_DEG else "stop_outside"
            return Event(kind, length, B=names.name(near[0]))
    turned_m = max((t.along_m + 0.3 for t in facts.turns), default=0.0)
    from_m = max(length - _PAST_M, turned_m)
    past = names.best(
        lambda m: (
            m.distance_m
            if passed(m, facts, from_m, length - 0.4) and abs(m.goal_bearing_deg) >= _BEHIND_DEG
            else None
        )
    )
    if past is not None and not past.plural:
        sided = names.rng.random() < taste.paced
        kind = "stop_past_side" if sided else "stop_past"
        return Event(kind, length, X=past, s=past.mark.side)
    hung = names.best(lambda m: m.goal_distance_m if hung_at_goal(m, facts) else None, at_goal=True)
    if hung is not None:
        return Event("stop_close", length, X=hung)
    if door := _door_at_goal(facts):
        return Event("stop_door", length, C=names.name(door))
    ahead = names.best(lambda m: in_view(m, facts, length, 25.0, _AHEAD_M))
    if ahead is not None and taste.voice != "terse":
        return Event("stop_facing", length, X=ahead, far_m=1.0)
    return Event("stop_after", length, far_m=1.0)


def _door_at_goal(facts: PathFacts) -> str:
    """Return the room behind the only doorway at the goal, if it is new and alone of its kind."""
    doors = [
        mark for mark in facts.landmarks
        if mark.noun == DOOR and mark.goal_open and mark.goal_distance_m <= _AT_DOOR_M
        and abs(mark.goal_bearing_deg) <= 125.0
    ]  # fmt: skip
    visited, beyond = {v.room for v in facts.visits}, facts.visits[-1].beyond
    rooms = {room for mark in doors for room in mark.leads if room not in visited}
    clear = len(doors) == 1 == len(rooms) and all(beyond.count(room) == 1 for room in rooms)
    return rooms.pop() if clear else ""


def _off_deg(room: str, facts: PathFacts) -> float:
    """Return how far aside of who stops the nearest way into a room lies [deg]."""
    ways = (m for m in facts.landmarks if m.noun in (DOOR, OPENING) and room in m.leads)
    nearest = min(ways, key=lambda m: m.goal_distance_m, default=None)
    return 90.0 if nearest is None else abs(nearest.goal_bearing_deg)


def _since_door_m(facts: PathFacts) -> float:
    """Return how far the path goes on behind its last doorway [m]."""
    storey_m = max((climb.to_m for climb in facts.climbs), default=-np.inf)
    last = facts.doors[-1].along_m if facts.doors else -np.inf
    return facts.length_m - last if last > storey_m else np.inf


def _at(thing: Reference, facts: PathFacts, names: Names, taste: Taste) -> Event:
    """Return the stop at a thing, and what more is said of its place."""
    mark, bearing_deg = thing.mark, thing.mark.goal_bearing_deg
    near = mark.goal_distance_m <= STOP_AT_M
    ahead = near and abs(bearing_deg) < 32.0
    kind = "stop_beside" if mark.goal_distance_m <= _BESIDE_M else "stop_close"
    event = Event("stop_front" if ahead else kind, facts.length_m, X=thing)
    across = names.best(
        lambda m: m.goal_distance_m if at_goal(m, facts) and _faces(bearing_deg, m.goal_bearing_deg)
        else None,
        at_goal=True,
    )  # fmt: skip
    if across is not None and names.rng.random() < 0.5:
        return replace(event, kind="stop_between", Y=across)
    side = "left" if bearing_deg > 0 else "right"
    options: list[Event] = []
    before = moment_at(mark, facts.length_m - _COMES_M)
    # "When the sofa is on your right" says nothing if the sofa was there all along.
    if near and 55.0 < abs(bearing_deg) < 125.0 and before and abs(before.bearing_deg) < 40.0:
        options.append(replace(event, kind="stop_side", s=side))
    if event.kind == "stop_close":
        return event
    if _since_door_m(facts) <= _STEPS_INSIDE_M:
        options.append(replace(event, kind="stop_in_by"))
    if names.rng.random() < taste.more:
        view = names.best(lambda m: in_view(m, facts, facts.length_m, 25.0, 2.5), at_goal=True)
        if not ahead and view is not None:
            options.append(replace(event, kind="stop_view", Y=view))
        if across is not None:
            other = "right" if side == "left" else "left"
            options.append(replace(event, kind="stop_with", Y=across, s=other))
    return pick([event, *options], names.rng)


def _stops_in_doorway(facts: PathFacts) -> bool:
    """Return whether the path stops in the doorway of a room that is new and alone of its kind."""
    if len(facts.goal_rooms) != 1 or facts.goal_rooms[0] in (v.room for v in facts.visits):
        return False
    doors = (mark for mark in facts.landmarks if mark.noun == DOOR)
    return (
        facts.visits[-1].beyond.count(facts.goal_rooms[0]) <= 1
        and min((door.goal_distance_m for door in doors), default=np.inf) <= _IN_DOORWAY_M
    )


def _faces(one_deg: float, other_deg: float) -> bool:
    """Return whether two things lie on either side of the stop."""
    sides = sorted((one_deg, other_deg))
    return -120.0 < sides[0] < -50.0 and 50.0 < sides[1] < 120.0
