"""Names of rooms by a vision-language model, for scans whose rooms have no labels.

A model gets a few frames of each room and says which kind of room each was taken in. Its names are
data like any label: one that is no room of the lexicon names nothing.
"""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from ...wayfinding.regions import RegionMap
from ..facts.named import NamedRoom
from ..language.nouns import room_of
from .client import Client
from .sight import Tally, View, answer_to

FRAMES = 3  # of one room that a model is asked about
_MIN_VOTES = 2  # of FRAMES: more than half
# More of what a frame shows must lie in the room that the camera is in: through a door it shows
# the next one.
_OWN_SHARE = 0.5
_STEP_PX = 8


class RoomSight(BaseModel):
    """The kind of room that a frame is taken in; "" where it is not clear."""

    model_config = ConfigDict(extra="ignore")

    room: str = Field(max_length=40)


def name_rooms(
    client: Client, views: Sequence[View], regions: Mapping[int, RegionMap]
) -> tuple[list[NamedRoom], Tally]:
    """Return the rooms that a model names alike in most of their frames, and in at least two.

    A room that two frames name differently has no name unless a third one decides. The client's
    backend asks for `RoomSight`: `openai_backend(settings, form=RoomSight)`.

    Args:
        client: asks.
        views: frames; those of which too little shows the room that they are taken in are left out.
        regions: rooms of each level on which a frame was taken.

    Raises:
        ModelDownError: the model fails again and again.
        BudgetError: no more may be spent.
    """
    named: list[NamedRoom] = []
    asked = unanswered = unknown = 0
    for (level, _), frames in _best_frames(views, regions).items():
        votes: Counter[str] = Counter()
        for view in frames:
            asked += 1
            answer = answer_to(client, view.png, RoomSight, "room")
            unanswered += answer is None
            if answer and answer.room.strip():
                name = room_of(answer.room)
                unknown += not name
                votes[name] += 1
        name, count = votes.most_common(1)[0] if votes else ("", 0)
        if name and count >= _MIN_VOTES:
            x, y = frames[0].eye_m[:2].tolist()
            named.append(NamedRoom(name, (x, y), level))
    return named, Tally(asked, unanswered, unknown)


def _best_frames(
    views: Sequence[View], regions: Mapping[int, RegionMap]
) -> dict[tuple[int, int], list[View]]:
    """Return by level and region the frames that show most of the room they are taken in."""
    found: dict[tuple[int, int], list[tuple[float, View]]] = {}
    for view in views:
        rooms = regions[view.level]
        own, share = int(rooms.at(view.eye_m[:2])), _own_share(view, rooms)
        if own >= 0 and share > _OWN_SHARE:
            found.setdefault((view.level, own), []).append((share, view))
    return {
        room: [view for _, view in sorted(frames, key=lambda one: -one[0])[:FRAMES]]
        for room, frames in sorted(found.items())
    }


def _own_share(view: View, regions: RegionMap) -> float:
    """Return how much of what a frame shows in rooms lies in the one that the camera is in."""
    points = view.points_m[::_STEP_PX, ::_STEP_PX].reshape(-1, 3)
    shown = regions.at(points[np.isfinite(points).all(axis=1), :2])
    shown = shown[shown >= 0]
    return float((shown == regions.at(view.eye_m[:2])).mean()) if len(shown) else 0.0
