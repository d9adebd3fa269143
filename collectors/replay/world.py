"""A scene level with a robot in it, ready to replay any number of episodes."""

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...formats.core.arrays import Array
from ...formats.scene.bundle import SceneBundle
from ...formats.scene.freemap import Freemap
from ..controllers import PACE_M_S, Coasting, Pose
from ..locomotion.runtime.coasting import coasting_of
from ..locomotion.runtime.drives import gait_for
from ..locomotion.runtime.footing import UNEVEN_M
from ..locomotion.runtime.policy import GaitPolicy
from ..physics import (
    FloorSurface,
    JoinedFloor,
    LevelModelConfig,
    ObstacleGate,
    level_model,
    storeys_model,
)
from ..physics.ground import Ground, GroundHere
from ..robots import RobotHandles, RobotSpec

SPAWN_GAP_M = 0.003  # between the lowest foot and the floor
TOUCHING_M = -0.001  # a start is in collision when something is deeper inside an obstacle


class Gait(Protocol):
    """Actuation of the joints; `drives` implements wheels and trained policies."""

    @property
    def memory(self) -> tuple[NDArray[Any], ...]:
        """The arrays in which it keeps what it remembers between steps."""
        ...

    def reset(self, seed: int | None = None) -> None:
        """Forget everything; called at the start of every rollout.

        Args:
            seed: of the errors of the sensors from which the state is estimated; the true state is
                seen when None.
        """
        ...

    def act(self, data: mujoco.MjData, command: ArrayLike) -> Array:
        """Return joint targets for the next 20 ms; see `GaitPolicy.act`."""
        ...


@dataclass(frozen=True)
class World:
    """Physics, robot and maps shared by all episodes of one level and one robot.

    With a staircase, that is both levels that it joins, and the staircase.

    Attributes:
        level: where episodes start.
        staircase: None for one level alone.
        ground: the ground around the robot, in a world with a staircase.
        model, data: compiled physics and its state; `data` is reused by every episode.
        handles: where the robot's state lies in them.
        base: (7,) view of the base's position and quaternion in `data`.
        freemap: where robots may be.
        obstacles: number of obstacle geoms, which come first in the model.
        gate: disables obstacle contacts while no obstacle is within reach.
        physics_hash: of the robot; see `RobotSpec.physics_hash`.
    """

    bundle: SceneBundle
    level: int
    robot: RobotSpec
    model: mujoco.MjModel
    data: mujoco.MjData
    handles: RobotHandles
    base: Array
    gait: Gait
    surface: FloorSurface | JoinedFloor
    freemap: Freemap
    obstacles: int
    gate: ObstacleGate
    physics_hash: str
    staircase: int | None = None
    ground: Ground | None = None

    @property
    def pose(self) -> Pose:
        """The base's true pose."""
        x, y, _, w, i, j, k = self.base.tolist()
        return Pose(x, y, math.atan2(2 * (w * k + i * j), 1 - 2 * (j * j + k * k)))

    @cached_property
    def coasting(self) -> Coasting:
        """Stopping distances and turn lag of the robot."""
        return coasting_of(self.robot, self.gait)

    @property
    def foot_z_m(self) -> float:
        """Height at which the robot's feet are while it stands or walks [m]."""
        return float(self.base[2]) - self.robot.base_height_m

    def spawn(
        self, pose: Pose, joint_noise_rad: Array | None = None, near_z_m: float | None = None
    ) -> None:
        """Reset physics and stand the robot on the floor, its feet a few mm above it.

        Args:
            pose: where.
            joint_noise_rad: (J,) added to the default joint positions.
            near_z_m: about the height of that floor; that of the level when None.
        """
        if near_z_m is None:
            near_z_m = self.bundle.level_floor_z_m[self.level]
        self.gate.open()
        mujoco.mj_resetData(self.model, self.data)
        floor_z = float(self.surface.height_at((pose.x_m, pose.y_m), near_z_m))
        at = {"x_m": pose.x_m, "y_m": pose.y_m, "yaw_rad": pose.yaw_rad}
        self.handles.spawn(self.data, floor_z_m=floor_z, **at)
        mujoco.mj_kinematics(self.model, self.data)
        soles = self.handles.sole_geoms.ravel()
        feet, radius = self.data.geom_xpos[soles], self.handles.sole_radius_m.ravel()
        ring = np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)])
        under = feet[:, None, :2] + radius[:, None, None] * ring
        gap = (feet[:, 2] - radius)[:, None] - self.surface.height_at(under, floor_z)
        raised_z = floor_z + SPAWN_GAP_M - float(gap.min())
        self.handles.spawn(self.data, floor_z_m=raised_z, **at)
        if joint_noise_rad is not None:
            self.data.qpos[self.handles.joint_qpos] += joint_noise_rad
        mujoco.mj_forward(self.model, self.data)

    def act(self, command: tuple[float, float, float]) -> None:
        """Let the gait set the servos for the next 20 ms."""
        self.gate.update()
        self.data.ctrl[self.handles.actuators] = self.gait.act(self.data, command)

    def paced(self, command: tuple[float, float, float]) -> tuple[float, float, float]:
        """Return a command, no faster than a robot with a footing takes uneven ground."""
        footing = self.gait.card.footing if isinstance(self.gait, GaitPolicy) else None
        if self.ground is None or footing is None:
            return command
        pose = np.array([[self.pose.x_m, self.pose.y_m, self.pose.yaw_rad]])
        if np.ptp(footing.scan(self.ground, pose)) <= UNEVEN_M:
            return command
        vx, vy, yaw = command
        return min(max(vx, -PACE_M_S), PACE_M_S), vy, yaw

    def touched_parts(self, deeper_than_m: float = 0.0) -> frozenset[str]:
        """Return the names of the robot's bodies that touch an obstacle now."""
        if not self.data.ncon or not self.gate.open_bodies:
            return frozenset()
        geoms = self.data.contact.geom
        if geoms.min() >= self.obstacles:
            return frozenset()
        hits = (geoms.min(axis=1) < self.obstacles) & (self.data.contact.dist <= deeper_than_m)
        bodies = self.model.geom_bodyid[geoms[hits].max(axis=1)]
        prefix = self.handles.prefix
        return frozenset(self.model.body(int(b)).name.removeprefix(prefix) for b in bodies)

    def in_collision(self) -> frozenset[str]:
        """Return the names of the robot's bodies that are inside an obstacle."""
        return self.touched_parts(TOUCHING_M)


def open_world(
    bundle: SceneBundle,
    level: int,
    robot: RobotSpec,
    gait: Gait | None = None,
    config: LevelModelConfig | None = None,
    cache_dir: Path | None = None,
    staircase: int | None = None,
) -> World:
    """Build or load the physics of a level with `robot`.

    Args:
        level: where episodes start.
        gait: actuation of the joints; the robot's own wheels or policy when None.
        cache_dir: where compiled models are kept; none are when None.
        staircase: joins the level with another one, if not None.

    Raises:
        ValueError: no such level.
        InputError: no such staircase, or nobody can climb it.
        FileFormatError: the level's or the policy's files are missing or broken.
    """
    config = config or LevelModelConfig()
    if staircase is None:
        model = level_model(bundle, level, robot, config, cache_dir)
        surface = FloorSurface(bundle.floor(level))
    else:
        model = storeys_model(bundle, staircase, robot, config, cache_dir)
        surface = JoinedFloor.of(bundle, staircase)
    data = mujoco.MjData(model)
    handles = RobotHandles.find(robot, model)
    base = data.qpos[handles.root_qpos : handles.root_qpos + 7]
    gait = gait or gait_for(robot)
    ground = None
    if isinstance(surface, JoinedFloor):
        ground = GroundHere(surface, base, robot.base_height_m)
        gait = gait.over(ground) if isinstance(gait, GaitPolicy) else gait
    return World(
        bundle=bundle,
        level=level,
        robot=robot,
        model=model,
        data=data,
        handles=handles,
        base=base,
        gait=gait,
        surface=surface,
        freemap=bundle.freemap(level).for_height(config.free_height_m),
        obstacles=int(np.count_nonzero(model.geom_bodyid == 0)),
        gate=ObstacleGate(model, data, handles.root_body, bundle.floor(level).grid),
        physics_hash=robot.physics_hash(),
        staircase=staircase,
        ground=ground,
    )
