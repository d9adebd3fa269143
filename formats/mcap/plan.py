"""The reference path, the walked path and the goal, to be seen in Foxglove's 3D panel."""

from collections.abc import Iterator

import numpy as np
from foxglove.channels import SceneUpdateChannel
from foxglove.messages import (
    Color,
    LinePrimitive,
    LinePrimitiveLineType,
    Point3,
    SceneEntity,
    SceneUpdate,
    SpherePrimitive,
    Vector3,
)
from numpy.typing import NDArray

from ..core.rollout import Rollout
from .recording import Recording, timestamp
from .topics import WORLD_FRAME, Write, logged, pose

PLAN_TOPIC = "/plan"
WALKED_EVERY = 25  # samples between points of the walked path
REFERENCE_COLOR = Color(r=0.1, g=0.6, b=0.2, a=1.0)
WALKED_COLOR = Color(r=0.2, g=0.4, b=0.9, a=1.0)
GOAL_COLOR = Color(r=0.9, g=0.5, b=0.1, a=0.6)
GOAL_DIAMETER_M = 0.25
UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])


def plan_messages(
    recording: Recording, rollout: Rollout, walked_every: int = WALKED_EVERY
) -> Iterator[Write]:
    """Yield one message at the start: both paths and the goal, if known, in the world frame."""
    channel = SceneUpdateChannel(PLAN_TOPIC, context=recording.context)
    episode, start_s = rollout.episode, rollout.time_s[0]
    goal = SpherePrimitive(
        pose=pose(episode.goal_position_world_m, UNTURNED),
        size=Vector3(x=GOAL_DIAMETER_M, y=GOAL_DIAMETER_M, z=GOAL_DIAMETER_M),
        color=GOAL_COLOR,
    )
    entity = SceneEntity(
        timestamp=timestamp(start_s),
        frame_id=WORLD_FRAME,
        id="plan",
        lines=[
            _line(episode.reference_path_world_m, REFERENCE_COLOR),
            _line(rollout.position_world_m[::walked_every], WALKED_COLOR),
        ],
        spheres=[goal] if np.isfinite(episode.goal_position_world_m).all() else [],
    )
    yield logged(channel, start_s, SceneUpdate(entities=[entity]))


def _line(points_world_m: NDArray, color: Color) -> LinePrimitive:
    return LinePrimitive(
        type=LinePrimitiveLineType.LineStrip,
        pose=pose(np.zeros(3), UNTURNED),
        thickness=0.03,
        points=[Point3(x=x, y=y, z=z) for x, y, z in points_world_m.tolist()],
        color=color,
    )
