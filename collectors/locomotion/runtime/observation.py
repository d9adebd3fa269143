"""What a policy sees, computed by the same code in training and in replay.

Only generalised positions and velocities enter: they are current after every physics step, while
sensors and body poses lag one step behind.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...robots import RobotHandles

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RobotState:
    """State of N robots with J joints, vectors in the base frame.

    Attributes:
        linear_velocity_m_s: (N, 3).
        angular_velocity_rad_s: (N, 3).
        gravity: (N, 3) unit vector downwards.
        joint_rad: (N, J) joint positions.
        joint_rad_s: (N, J) joint velocities.
    """

    linear_velocity_m_s: Array
    angular_velocity_rad_s: Array
    gravity: Array
    joint_rad: Array
    joint_rad_s: Array


def states_of(qpos: Array, qvel: Array, handles: RobotHandles) -> RobotState:
    """Return the states of N robots from generalised positions (N, nq) and velocities (N, nv).

    Of the joints only those that a policy moves, J of them.
    """
    joints = handles.robot.policy_joints
    q, v = handles.root_qpos, handles.root_dof
    quat_wxyz = qpos[:, q + 3 : q + 7]
    return RobotState(
        linear_velocity_m_s=rotate_to_base(quat_wxyz, qvel[:, v : v + 3]),
        angular_velocity_rad_s=qvel[:, v + 3 : v + 6],
        gravity=gravity_in_base(quat_wxyz),
        joint_rad=qpos[:, handles.joint_qpos[:joints]],
        joint_rad_s=qvel[:, handles.joint_dof[:joints]],
    )


def layout(joints: int, past: int = 0) -> list[tuple[str, int]]:
    """Return the names and widths of the blocks of one observation, in order.

    Of each of the `past` policy steps before, the latest first, it repeats the last three blocks:
    what the motors were told and what they did, from which a network finds out how late they are.
    """
    now = [
        ("linear_velocity_base_m_s", 3),
        ("angular_velocity_base_rad_s", 3),
        ("gravity_base", 3),
        ("command_vx_vy_yaw", 3),
        ("gait_phase_sin_cos", 2),
        ("joint_minus_default_rad", joints),
        ("joint_velocity_rad_s", joints),
        ("previous_action", joints),
    ]
    return now + [
        (f"{name}_{step}_ago", width) for step in range(1, past + 1) for name, width in now[-3:]
    ]


def past_steps(blocks: list[tuple[str, int]]) -> int:
    """Return how many earlier steps the blocks of a `layout` repeat."""
    return sum(name.startswith("previous_action_") for name, _ in blocks)


def remember(now: Array, before: Array | None, joints: int, past: int) -> Array:
    """Append to observations (N, D) of the present the last blocks of the `past` steps before.

    Args:
        now: (N, D) as of `observe`.
        before: what this function returned a step ago; a robot that just started has None, and
            takes what it sees for its past.
        joints: that the policy moves.
        past: number of steps.
    """
    tail = 3 * joints
    if before is None:
        return np.hstack([now, *[now[:, -tail:]] * past])
    width = now.shape[1]
    last, earlier = before[:, width - tail : width], before[:, width : width + tail * (past - 1)]
    return np.hstack([now, last, earlier]) if past else now


def rotate_to_base(quat_wxyz: Array, vector_world: Array) -> Array:
    """Express (N, 3) world vectors in base frames given by (N, 4) unit quaternions."""
    w, axis = quat_wxyz[:, :1], quat_wxyz[:, 1:]
    # v' = v − 2w (q × v) + 2 q × (q × v), the inverse rotation.
    cross = _cross(axis, vector_world)
    return vector_world - 2.0 * w * cross + 2.0 * _cross(axis, cross)


def gravity_in_base(quat_wxyz: Array) -> Array:
    """Return (N, 3) unit gravity in base frames: (0, 0, −1) when level."""
    w, x, y, z = quat_wxyz.T
    return np.stack(
        [2.0 * (w * y - x * z), -2.0 * (w * x + y * z), 2.0 * (x * x + y * y) - 1.0], axis=1
    )


def observe(
    state: RobotState,
    default_joint_rad: Array,
    command: Array,
    phase: Array,
    moving: NDArray[np.bool_],
    previous_action: Array,
) -> Array:
    """Return the observations (N, D) in the order of `layout`.

    Args:
        state: of N robots.
        default_joint_rad: (J,).
        command: (N, 3) vx, vy [m/s] and yaw rate [rad/s] in the base frame.
        phase: (N,) gait phase in cycles.
        moving: (N,) a standing robot sees (0, 0) for its phase.
        previous_action: (N, J) the policy's last output.
    """
    angle = 2.0 * np.pi * phase[:, None]
    moves = moving[:, None]
    return np.concatenate(
        [
            state.linear_velocity_m_s,
            state.angular_velocity_rad_s,
            state.gravity,
            command,
            np.sin(angle) * moves,
            np.cos(angle) * moves,
            state.joint_rad - default_joint_rad,
            state.joint_rad_s,
            previous_action,
        ],
        axis=1,
    )


def _cross(a: Array, b: Array) -> Array:
    # np.cross costs ten times as much for such small arrays.
    ax, ay, az = a.T
    bx, by, bz = b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
