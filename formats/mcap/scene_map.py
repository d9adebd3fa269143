"""The planning map of the episode's level as a Foxglove grid, under the robot's feet."""

from __future__ import annotations

import numpy as np
from foxglove.messages import (
    Grid,
    PackedElementField,
    PackedElementFieldNumericType,
    Pose,
    Quaternion,
    Vector2,
    Vector3,
)

from ..scene.freemap import Freemap
from .recording import nanoseconds, timestamp
from .shown import MAP_TOPIC, ShownTopic
from .topics import WORLD_FRAME

# RGBA. Where there is no floor the map is clear.
FREE, BLOCKED, NOTHING = (205, 214, 205, 255), (96, 96, 104, 255), (0, 0, 0, 0)
BELOW_M = 0.02  # so that paths and feet are drawn over it


def map_topic(freemap: Freemap, time_s: float = 0.0) -> ShownTopic:
    """One message: free floor, floor that something stands on or hangs over, and no floor."""
    floor = np.isfinite(freemap.floor_z_m)
    kind = np.where(floor, np.where(freemap.traversable, 0, 1), 2)
    colors = np.array([FREE, BLOCKED, NOTHING], np.uint8)[kind]
    columns = kind.shape[1]
    x, y = (float(v) for v in freemap.grid.origin_xy_m)
    z = float(np.median(freemap.floor_z_m[floor])) - BELOW_M if floor.any() else 0.0
    fields = [
        PackedElementField(name=name, offset=k, type=PackedElementFieldNumericType.Uint8)
        for k, name in enumerate(("red", "green", "blue", "alpha"))
    ]
    grid = Grid(
        timestamp=timestamp(time_s),
        frame_id=WORLD_FRAME,
        pose=Pose(
            position=Vector3(x=x, y=y, z=z), orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
        ),
        column_count=columns,
        cell_size=Vector2(x=freemap.grid.cell_m, y=freemap.grid.cell_m),
        row_stride=4 * columns,
        cell_stride=4,
        fields=fields,
        data=colors.tobytes(),
    )
    schema = Grid.get_schema()
    return ShownTopic(
        MAP_TOPIC, schema.name, schema.data, ((nanoseconds(time_s), bytes(grid.encode())),)
    )
