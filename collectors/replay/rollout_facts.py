"""Facts of a rollout beside its samples: the expert's labels and the provenance."""

from dataclasses import asdict
from typing import Any

import mujoco

from ...formats.core.arrays import Array
from ...formats.core.frames import quat_to_yaw
from ...formats.core.rollout import DISCRETE_RATE_HZ, STATE_RATE_HZ, Action
from ..controllers import Pose, Task, expert_for
from ..locomotion.runtime import GaitPolicy
from ..locomotion.runtime.gait import RATE_HZ
from ..robots import TIMESTEP_S
from .config import ReplayConfig
from .world import World


def expert_labels(task: Task, position_world_m: Array, quat_wxyz: Array) -> tuple[Action, ...]:
    """Return the expert's action at each frame of a robot that follows its path.

    Args:
        position_world_m: (N, 3) at 100 Hz.
        quat_wxyz: (N, 4).
    """
    every = STATE_RATE_HZ // DISCRETE_RATE_HZ
    expert = expert_for(task)
    yaws = quat_to_yaw(quat_wxyz[::every]).tolist()
    return tuple(
        expert.next_action(Pose(x, y, yaw))
        for (x, y, _), yaw in zip(position_world_m[::every].tolist(), yaws, strict=True)
    )


def provenance(world: World, config: ReplayConfig, *, teleports: bool) -> dict[str, Any]:
    """Return what made a rollout: seed, robot, gait, controller and physics."""
    gait = None if teleports else world.gait
    walks = isinstance(gait, GaitPolicy)
    floor = mujoco.mjtGeom(int(world.model.geom("floor").type[0]))
    stairs = gait.stairs if walks and world.ground else None
    return {
        "seed": config.seed,
        "robot_mass_kg": world.robot.mass_kg,
        "robot_physics": world.physics_hash,
        "policy_sha256": gait.card.network_sha256 if walks else None,
        **({"stairs_policy_sha256": stairs.card.network_sha256} if stairs else {}),
        "policy_state": config.state if walks else None,
        "controller_config": asdict(getattr(config, config.controller)),
        "timestep_s": TIMESTEP_S,
        "policy_rate_hz": RATE_HZ,
        "mujoco": mujoco.__version__,
        "floor": floor.name.removeprefix("mjGEOM_").lower(),
        "obstacle_boxes": world.obstacles,
    }


def state_in_words(data: mujoco.MjData) -> dict[str, list[str]]:
    """Return a simulation's state with its numbers as text: JSON knows no NaN."""
    return {
        name: [repr(v) for v in getattr(data, name).tolist()] for name in ("qpos", "qvel", "ctrl")
    }
