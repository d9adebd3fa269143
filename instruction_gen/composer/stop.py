"""Choose how to say where a path stops."""

import numpy as np

from ..facts.doors import DOOR
from ..facts.records import PassageFact, PathFacts
from .records import Step, Taste
from .refer import Reference, passing_candidates, stop_candidates

_JUST_INSIDE_M, _STEPS_INSIDE_M = 1.25, 2.0
_PAST_M = 2.5
_IN_DOORWAY_M = 0.5


def stop_step(facts: PathFacts, rng: np.random.Generator, taste: Taste) -> Step:
    """Return the step that says where to stop."""
    length = facts.length_m
    if _stops_in_doorway(facts):
        # What is ahead lies in the next room, which the path does not enter.
        return Step("stop", length, place="outside", room=facts.goal_rooms[0])
    options = stop_candidates(facts, rng, taste.colours)
    if options:
        mark = options[0] if len(options) == 1 or rng.random() < 0.75 else options[1]
        other = next((o for o in options if _faces(mark, o)), None)
        if other is not None and rng.random() < 0.5:
            return Step(
                "stop", length, mark=mark, other=other, place="between", room=facts.goal_room
            )
        ahead = abs(mark.bearing_deg) < 32.0
        beside = "beside" if mark.distance_m <= 1.1 else "near"
        place = "front" if ahead else beside
        side = ""
        if 40.0 < abs(mark.bearing_deg) < 140.0 and rng.random() < 0.4 * taste.sides + 0.1:
            side = "left" if mark.bearing_deg > 0 else "right"
        return Step("stop", length, side=side, mark=mark, place=place, room=facts.goal_room)
    visits = facts.visits
    since_door_m = length - facts.passages[-1].along_m if facts.passages else np.inf
    if since_door_m <= _JUST_INSIDE_M:
        return Step("stop", length, place="inside", room=entered_room(facts.passages[-1]))
    if since_door_m <= _STEPS_INSIDE_M:
        return Step("stop", length, place="after", far_m=1.0)
    if len(facts.goal_near_rooms) == 1 and facts.goal_near_rooms[0] not in (v.room for v in visits):
        return Step("stop", length, place="outside", room=facts.goal_near_rooms[0])
    passed = passing_candidates(facts, length - _PAST_M, length - 0.4, rng, taste.colours)
    if passed:
        return Step("stop", length, mark=passed[0], place="past", room=facts.goal_room)
    return Step("stop", length, place="after", far_m=1.0)


def _stops_in_doorway(facts: PathFacts) -> bool:
    """Return whether the path stops in the doorway of a room that is new and alone of its kind."""
    if len(facts.goal_rooms) != 1 or facts.goal_rooms[0] in (v.room for v in facts.visits):
        return False
    doors = (mark for mark in facts.landmarks if mark.noun == DOOR)
    return (
        facts.visits[-1].beyond.count(facts.goal_rooms[0]) <= 1
        and min((door.goal_distance_m for door in doors), default=np.inf) <= _IN_DOORWAY_M
    )


def _faces(mark: Reference, other: Reference) -> bool:
    """Return whether two things lie on either side of the stop."""
    sides = sorted((mark.bearing_deg, other.bearing_deg))
    return -140.0 < sides[0] < -40.0 and 40.0 < sides[1] < 140.0 and mark.noun != other.noun


def entered_room(passage: PassageFact) -> str:
    """Return the room entered, told from one of the same kind that is left."""
    if not passage.to_room or passage.to_room != passage.from_room:
        return passage.to_room
    return f"{'next' if passage.to_room == 'hallway' else 'other'} {passage.to_room}"
