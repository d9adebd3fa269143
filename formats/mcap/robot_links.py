"""The robot's body in Foxglove: shapes fixed to link frames, and where the links are."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from foxglove.messages import (
    Color,
    CubePrimitive,
    CylinderPrimitive,
    FrameTransforms,
    Point3,
    Pose,
    SceneEntity,
    SceneUpdate,
    SpherePrimitive,
    TriangleListPrimitive,
)
from numpy.typing import NDArray

from ..core.arrays import Array
from .recording import nanoseconds, timestamp
from .shown import LINK_TOPIC, ROBOT_TOPIC, ShownTopic
from .topics import BASE_FRAME, pose, transform, vector

LINK_PREFIX = "link/"  # of frame names, so that no link is taken for `base` or `world`
CUBE, SPHERE, CYLINDER, TRIANGLES = "cube", "sphere", "cylinder", "triangles"


@dataclass(frozen=True)
class LinkShape:
    """A shape fixed to a link.

    Attributes:
        kind: `cube`, `sphere` (an ellipsoid), `cylinder` (along z) or `triangles`.
        position_link_m, quat_wxyz: (3,), (4,) its pose in the link's frame.
        size_m: (3,) full extent along its axes; of triangles unused.
        rgba: (4,) 0 … 1.
        corners_m: (F, 3, 3) of triangles, in the shape's frame.
    """

    kind: str
    position_link_m: Array
    quat_wxyz: Array
    size_m: Array
    rgba: tuple[float, float, float, float]
    corners_m: Array | None = None


@dataclass(frozen=True)
class RobotLinks:
    """A robot's links along a rollout.

    Attributes:
        names: of the L links.
        time_s: (N,).
        position_base_m, quat_wxyz: (N, L, 3), (N, L, 4) of each link in the base frame.
    """

    names: tuple[str, ...]
    shapes: tuple[tuple[LinkShape, ...], ...]
    time_s: Array
    position_base_m: Array
    quat_wxyz: Array


def robot_topics(links: RobotLinks) -> tuple[ShownTopic, ...]:
    """Return the body, once, and a transform base → link of every link and time."""
    if not links.names:
        return ()
    start = float(links.time_s[0])
    parts = zip(links.names, links.shapes, strict=True)
    body = SceneUpdate(entities=[_entity(name, shapes, start) for name, shapes in parts])
    # Single precision is a micrometre here, and half of each number's bytes are zeros to compress.
    position = links.position_base_m.astype(np.float32)
    rotation = links.quat_wxyz.astype(np.float32)
    moves = tuple(
        (nanoseconds(time_s), _transforms(links.names, time_s, *poses))
        for time_s, *poses in zip(links.time_s.tolist(), position, rotation, strict=True)
    )
    shown = (nanoseconds(start), bytes(body.encode()))
    first, second = SceneUpdate.get_schema(), FrameTransforms.get_schema()
    return (
        ShownTopic(ROBOT_TOPIC, first.name, first.data, (shown,)),
        ShownTopic(LINK_TOPIC, second.name, second.data, moves),
    )


def _transforms(names: Sequence[str], time_s: float, position: NDArray, rotation: NDArray) -> bytes:
    """Return the encoded transforms base → link."""
    links = zip(names, position, rotation, strict=True)
    moved = [transform(BASE_FRAME, LINK_PREFIX + name, time_s, *place) for name, *place in links]
    return bytes(FrameTransforms(transforms=moved).encode())


def _entity(name: str, shapes: Sequence[LinkShape], time_s: float) -> SceneEntity:
    def bodies(kind: str, primitive: Callable[..., Any], **more: float) -> list[Any]:
        return [
            primitive(pose=_pose(s), size=vector(s.size_m), color=_color(s), **more)
            for s in shapes
            if s.kind == kind
        ]

    return SceneEntity(
        timestamp=timestamp(time_s),
        frame_id=LINK_PREFIX + name,
        id=name,
        frame_locked=True,
        cubes=bodies(CUBE, CubePrimitive),
        spheres=bodies(SPHERE, SpherePrimitive),
        cylinders=bodies(CYLINDER, CylinderPrimitive, bottom_scale=1.0, top_scale=1.0),
        triangles=[_triangles(shape) for shape in shapes if shape.kind == TRIANGLES],
    )


def _color(shape: LinkShape) -> Color:
    red, green, blue, alpha = shape.rgba
    return Color(r=red, g=green, b=blue, a=alpha)


def _pose(shape: LinkShape) -> Pose:
    return pose(shape.position_link_m, shape.quat_wxyz)


def _triangles(shape: LinkShape) -> TriangleListPrimitive:
    assert shape.corners_m is not None
    points, indices = np.unique(
        shape.corners_m.reshape(-1, 3).astype(np.float32), axis=0, return_inverse=True
    )
    return TriangleListPrimitive(
        pose=_pose(shape),
        points=[Point3(x=x, y=y, z=z) for x, y, z in points.tolist()],
        color=_color(shape),
        indices=np.ravel(indices).tolist(),
    )
