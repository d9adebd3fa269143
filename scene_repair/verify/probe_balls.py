"""Drop balls onto written triangles in MuJoCo."""

import mujoco
import numpy as np

from ...formats.core.arrays import F32, Array
from ...formats.core.geometry import distinct_rows
from .exported import Surface

BALL_RADIUS_M = 0.01
# Balls start with their lowest point this far above the floor, and get this long to settle.
DROP_M, SETTLE_S, STEP_S = 0.03, 0.4, 0.004
# Triangles within this distance are there for them, from this far under the floor on.
REACH_M, BELOW_M = 0.15, 0.1
TILE_M, BALLS_AT_ONCE = 2.0, 200
# Triangles are this thick, upwards and downwards: contact needs some depth.
SKIN_M = 1e-4


def drop_balls(triangles_m: F32, floor_m: Array) -> Array:
    """Drop a ball of 2 cm onto points (N, 3) of a floor; return where they end, (N, 3).

    The triangles (T, 3, 3) are solid from both sides (a rigid MuJoCo flex). Balls do not meet.
    """
    end = np.empty((len(floor_m), 3))
    tile = np.floor(floor_m[:, :2] / TILE_M).astype(np.int64)
    _, number = np.unique(tile, axis=0, return_inverse=True)
    surface = Surface(triangles_m, np.zeros(len(triangles_m), dtype=bool))
    for k in range(int(number.max(initial=-1)) + 1):
        selected = np.flatnonzero(number.ravel() == k)
        for start in range(0, len(selected), BALLS_AT_ONCE):
            some = selected[start : start + BALLS_AT_ONCE]
            lower = floor_m[some].min(axis=0) - np.array([REACH_M, REACH_M, BELOW_M])
            upper = floor_m[some].max(axis=0) + REACH_M
            end[some] = _drop(surface.between(lower, upper).triangles_m, floor_m[some])
    return end


def _drop(triangles_m: F32, floor_m: Array) -> Array:
    spec = mujoco.MjSpec()
    spec.option.timestep = STEP_S
    points = triangles_m.reshape(-1, 3)
    first, index = distinct_rows(points)
    corners = index.reshape(-1, 3)
    # Slivers whose corners meet in float32 hold nothing, and MuJoCo refuses them.
    corners = corners[np.all(corners != np.roll(corners, 1, axis=1), axis=1)]
    if len(corners):
        spec.add_flex(
            name="floor",
            dim=2,
            radius=SKIN_M,
            vertbody=["world"],
            vert=points[first].astype(np.float64).ravel().tolist(),
            elem=corners.ravel().tolist(),
            selfcollide=mujoco.mjtFlexSelf.mjFLEXSELF_NONE,
            contype=1,
            conaffinity=2,
        )
    for x, y, z in floor_m:
        body = spec.worldbody.add_body(pos=[x, y, z + DROP_M + BALL_RADIUS_M])
        body.add_freejoint()
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[BALL_RADIUS_M, 0.0, 0.0],
            contype=2,
            conaffinity=1,
        )
    model = spec.compile()
    data = mujoco.MjData(model)
    for _ in range(round(SETTLE_S / STEP_S)):
        mujoco.mj_step(model, data)
    return data.xpos[1:] - (0.0, 0.0, BALL_RADIUS_M)
