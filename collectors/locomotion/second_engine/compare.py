"""A second opinion on a gait: the same walks in MuJoCo and in Drake.

`python -m vlnpe.collectors.locomotion.second_engine.compare h1` walks 20 commands on flat ground,
on steps of 3 cm and under pushes in both engines, prints both tables and what Drake says to the
gates, and exits 1 if one is missed. `--publish` adds the table to the gait's card.
"""

import json
import logging
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, Any

import mujoco
import numpy as np
import tyro

from ....formats.core.arrays import Array
from ...robots import POLICY_DECIMATION, RobotSpec, get_robot
from ..runtime.card import save_card
from ..runtime.observation import states_of
from ..runtime.policy import GaitPolicy, policy_files
from ..trials.gates import Gate, GateResult, worst_of
from ..trials.pipe import TargetPipe
from ..trials.trial import STEP_S, fallen
from .worlds import BLOCK_M, DrakeWorld, MujocoWorld, World

log = logging.getLogger(__name__)

SETTLE_S, WALK_S, STOP_S = 1.0, 5.0, 3.0
WARM_UP_S = 2.0  # velocities count from then on
PUSH_M_S, PUSHES_S = 0.5, (2.0, 3.5)
STEP_HEIGHT_M, FLOOR_M = 0.03, 13.0
ENGINES: dict[str, Callable[[RobotSpec, Array | None], World]] = {
    "mujoco": MujocoWorld,
    "drake": DrakeWorld,
}
GATES = (
    Gate("falls in Drake, flat", "", 0, False, ("drake_flat",), "falls"),
    Gate("velocity error in Drake, flat", "m/s", 0.08, False, ("drake_flat",), "linear_error_m_s"),
    Gate("falls in Drake, steps of 3 cm", "", 1, False, ("drake_steps_3cm",), "falls"),
    Gate("falls in Drake, pushes of 0.5 m/s", "", 1, False, ("drake_pushes",), "falls"),
)


@dataclass(frozen=True)
class Walk:
    """One walk: a command (3,) held for 5 s, then a stop that is watched for 3 s.

    Attributes:
        late_substeps: physics steps by which actions come late.
        kicks_m_s: (K, 2) added to the base's velocity at `PUSHES_S`.
        heights_m: blocks of the floor, None for a flat one.
    """

    command: Array
    late_substeps: int = 0
    kicks_m_s: Array | None = None
    heights_m: Array | None = None


@dataclass(frozen=True)
class Outcome:
    """What became of a walk.

    Attributes:
        fell: before or after the stop.
        fell_stopped: after it.
        linear_error_m_s, yaw_error_rad_s: of the mean velocity; a robot that fell has none.
    """

    fell: bool
    fell_stopped: bool
    linear_error_m_s: float
    yaw_error_rad_s: float


def walk(policy: GaitPolicy, world: World, plan: Walk) -> Outcome:
    """Carry out a walk in a new world."""
    robot, h, data = policy.robot, world.handles, world.data
    policy.reset()
    pipe = TargetPipe(np.array([plan.late_substeps]))
    pipe.fill(robot.default_joint_rad[None])
    kicks = [] if plan.kicks_m_s is None else list(zip(PUSHES_S, plan.kicks_m_s, strict=True))
    velocity: list[Array] = []
    for step in range(round((SETTLE_S + WALK_S + STOP_S) / STEP_S)):
        time_s = step * STEP_S - SETTLE_S
        walking = 0.0 <= time_s < WALK_S
        if kicks and time_s >= kicks[0][0]:
            world.kick(kicks.pop(0)[1])
        targets = policy.act(data, plan.command if walking else np.zeros(3))
        world.advance(pipe.push(targets[None])[0])
        mujoco.mj_kinematics(data.model, data)
        mujoco.mj_comPos(data.model, data)
        state = states_of(data.qpos[None], data.qvel[None], h)
        if fallen(state.gravity, np.array([h.com_to_foot_m(data)]), robot.fall)[0]:
            error = plan.command if walking else np.mean(velocity, axis=0) - plan.command
            return Outcome(True, time_s >= WALK_S, np.hypot(*error[:2]), abs(error[2]))
        if walking and time_s >= WARM_UP_S:
            rate = state.angular_velocity_rad_s[0, 2]
            velocity.append(np.array([*state.linear_velocity_m_s[0, :2], rate]))
    error = np.mean(velocity, axis=0) - plan.command
    return Outcome(False, False, float(np.hypot(*error[:2])), float(abs(error[2])))


def plans(robot: RobotSpec, count: int, seed: int) -> dict[str, list[Walk]]:
    """Return walks by condition; every second one acts 20 ms late."""
    rng, limits = np.random.default_rng(seed), robot.command_limits
    low, high = np.array([limits.vx_m_s, limits.vy_m_s, limits.yaw_rad_s]).T
    late = [POLICY_DECIMATION * (k % 2) for k in range(count)]
    flat = [Walk(command, late[k]) for k, command in enumerate(rng.uniform(low, high, (count, 3)))]
    blocks = round(FLOOR_M / BLOCK_M)
    heights = rng.uniform(0.0, STEP_HEIGHT_M, (blocks, blocks))
    middle = slice(blocks // 2 - 1, blocks // 2 + 1)
    heights[middle, middle] = 0.0  # where it starts
    angle = rng.uniform(0.0, 2.0 * np.pi, (count, len(PUSHES_S)))
    kicks = PUSH_M_S * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return {
        "flat": flat,
        "steps_3cm": [replace(plan, heights_m=heights) for plan in flat],
        "pushes": [replace(plan, kicks_m_s=kicks[k]) for k, plan in enumerate(flat)],
    }


def comparison(
    policy: GaitPolicy, count: int = 20, seed: int = 77, engines: tuple[str, ...] = tuple(ENGINES)
) -> dict[str, dict[str, Any]]:
    """Return falls and velocity errors by engine and condition, such as `drake_flat`."""
    table: dict[str, dict[str, Any]] = {}
    for condition, walks in plans(policy.robot, count, seed).items():
        for engine in engines:
            outcomes = [
                walk(policy, ENGINES[engine](policy.robot, plan.heights_m), plan) for plan in walks
            ]
            table[f"{engine}_{condition}"] = {
                "walks": count,
                "falls": sum(outcome.fell for outcome in outcomes),
                "falls_after_stop": sum(outcome.fell_stopped for outcome in outcomes),
                "linear_error_m_s": float(np.mean([o.linear_error_m_s for o in outcomes])),
                "yaw_error_rad_s": float(np.mean([o.yaw_error_rad_s for o in outcomes])),
            }
            log.info("%s_%s %s", engine, condition, json.dumps(table[f"{engine}_{condition}"]))
    return table


def main(
    robot: Annotated[str, tyro.conf.Positional],
    count: int = 20,
    seed: int = 77,
    publish: bool = False,
) -> None:
    """Compare a gait's walks in both engines.

    Args:
        robot: registry name.
        count: commands.
        seed: of commands, floor and pushes.
        publish: add the table to the card, as `evaluation["second_engine"]`.
    """
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    policy = GaitPolicy.load(get_robot(robot))
    table = comparison(policy, count, seed)
    results = [GateResult(gate, worst_of(gate, table)) for gate in GATES]
    log.info("\n".join(map(str, results)))
    if publish:
        evaluation = {**policy.card.evaluation, "second_engine": table}
        save_card(replace(policy.card, evaluation=evaluation), policy_files(policy.robot)[1])
    sys.exit(not all(result.passed for result in results))


if __name__ == "__main__":
    tyro.cli(main)
