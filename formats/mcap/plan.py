"""The reference path, the walked path and the goal, to be seen in Foxglove's 3D panel."""

from collections.abc import Iterator

import numpy as np
from foxglove.channels import SceneUpdateChannel
from foxglove.messages import (
    Color,
    LinePrimitive,
    LinePrimitiveLineType,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    SceneUpdate,
    SpherePrimitive,
    Vector3,
)
from numpy.typing import NDArray

from ..core.rollout import Rollout
from .recording import Recording, nanoseconds, timestamp
from .topics import WORLD_FRAME, Write, vector

PLAN_TOPIC = "/plan"
WALKED_EVERY = 25  # samples between points of the walked path
REFERENCE_COLOR = Color(r=0.1, g=0.6, b=0.2, a=1.0)
WALKED_COLOR = Color(r=0.2, g=0.4, b=0.9, a=1.0)
GOAL_COLOR = Color(r=0.9, g=0.5, b=0.1, a=0.6)
GOAL_DIAMETER_M = 0.25
UPRIGHT = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)


def plan_messages(
    recording: Recording, rollout: Rollout, walked_every: int = WALKED_EVERY
) -> Iterator[Write]:
    """Yield one message at the start: both paths and the goal, if known, in the world frame."""
    channel = SceneUpdateChannel(PLAN_TOPIC, context=recording.context)
    at, stamp = nanoseconds(rollout.time_s[0]), timestamp(rollout.time_s[0])
    goal = SpherePrimitive(
        pose=Pose(position=vector(rollout.episode.goal_position_world_m), orientation=UPRIGHT),
        size=Vector3(x=GOAL_DIAMETER_M, y=GOAL_DIAMETER_M, z=GOAL_DIAMETER_M),
        color=GOAL_COLOR,
    )
    entity = SceneEntity(
        timestamp=stamp,
        frame_id=WORLD_FRAME,
        id="plan",
        lines=[
            _line(rollout.episode.reference_path_world_m, REFERENCE_COLOR),
            _line(rollout.position_world_m[::walked_every], WALKED_COLOR),
        ],
        spheres=[goal] if np.isfinite(rollout.episode.goal_position_world_m).all() else [],
    )
    yield at, lambda: channel.log(SceneUpdate(entities=[entity]), log_time=at)


def _line(points_world_m: NDArray, color: Color) -> LinePrimitive:
    return LinePrimitive(
        type=LinePrimitiveLineType.LineStrip,
        pose=Pose(
            position=Vector3(x=0.0, y=0.0, z=0.0),
            orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
        ),
        thickness=0.03,
        points=[Point3(x=x, y=y, z=z) for x, y, z in points_world_m.tolist()],
        color=color,
    )
