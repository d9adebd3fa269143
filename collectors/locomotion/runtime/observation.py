"""A policy's observation, computed by the same code in training and in replay.

Only generalised positions and velocities enter: they are current after every physics step, while
sensors and body poses lag one step behind.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....formats.core.arrays import Array, Mask
from ....formats.process.kernel import called, kernel
from ...robots import RobotHandles
from .footing import Footing


@dataclass(frozen=True)
class RobotState:
    """State of N robots with J joints, vectors in the base frame.

    Attributes:
        linear_velocity_m_s: (N, 3).
        angular_velocity_rad_s: (N, 3).
        gravity: (N, 3) unit vector downwards, (0, 0, −1) when level.
        joint_rad: (N, J) joint positions.
        joint_rad_s: (N, J) joint velocities.
    """

    linear_velocity_m_s: Array
    angular_velocity_rad_s: Array
    gravity: Array
    joint_rad: Array
    joint_rad_s: Array


class Places(NamedTuple):
    """Addresses of the state of a robot and its policy's joints; see `RobotHandles`."""

    root_qpos: int
    root_dof: int
    joint_qpos: NDArray[np.intp]
    joint_dof: NDArray[np.intp]

    @classmethod
    def of(cls, handles: RobotHandles) -> "Places":
        """Return the places of the joints that a policy moves."""
        moved = slice(handles.robot.policy_joints)
        joints = handles.joint_qpos[moved], handles.joint_dof[moved]
        return cls(handles.root_qpos, handles.root_dof, *joints)


def states_of(qpos: Array, qvel: Array, handles: RobotHandles) -> RobotState:
    """Return the states of N robots from generalised positions (N, nq) and velocities (N, nv).

    Only the joints that a policy moves are included, J of them.
    """
    places = Places.of(handles)
    body = np.empty((len(qpos), body_width(len(places.joint_qpos))))
    _true_bodies(qpos, qvel, places, body)
    return RobotState(*np.split(body, (3, 6, 9, 9 + len(places.joint_qpos)), axis=1))


def body_width(joints: int) -> int:
    """Return the width of a body: velocity, turn rates, gravity, joint positions and velocities."""
    return 9 + 2 * joints


def layout(joints: int, past: int = 0, footing: Footing | None = None) -> list[tuple[str, int]]:
    """Return the names and widths of the blocks of one observation, in order.

    The last three blocks are repeated for each of the `past` policy steps before, the latest first:
    the motors' commands and movements, from which a network finds out how late they are.
    With a `footing` the ground comes last, and gravity and joints are those over level ground.
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
    before = [
        (f"{name}_{step}_ago", width) for step in range(1, past + 1) for name, width in now[-3:]
    ]
    ground = [("slope", 1), ("height_scan_m", footing.width - 1)] if footing else []
    return now + before + ground


def past_steps(blocks: list[tuple[str, int]]) -> int:
    """Return how many earlier steps the blocks of a `layout` repeat."""
    return sum(name.startswith("previous_action_") for name, _ in blocks)


def present(blocks: list[tuple[str, int]]) -> Mask:
    """Return which numbers of an observation are no earlier steps', (D,)."""
    return np.concatenate([np.full(width, not name.endswith("_ago")) for name, width in blocks])


@called()
def to_base(quat, vector, out):
    """Write a world vector in the frame of an orientation to the first three of `out`."""
    # v' = v − 2w (q × v) + 2 q × (q × v), the inverse rotation.
    w, x, y, z = quat[0], quat[1], quat[2], quat[3]
    a, b, c = vector[0], vector[1], vector[2]
    i, j, k = y * c - z * b, z * a - x * c, x * b - y * a
    out[0] = a - 2.0 * w * i + 2.0 * (y * k - z * j)
    out[1] = b - 2.0 * w * j + 2.0 * (z * i - x * k)
    out[2] = c - 2.0 * w * k + 2.0 * (x * j - y * i)


@called()
def true_body(qpos, qvel, places, out):
    """Write the bodies of N robots, as a simulation knows them, to `out` (N, `body_width`).

    A body is what a policy sees of a robot: linear and angular velocity and gravity in the base
    frame, joint positions and velocities.
    """
    q, v = places.root_qpos, places.root_dof
    joint_qpos, joint_dof = places.joint_qpos, places.joint_dof
    joints = len(joint_qpos)
    for n in range(len(qpos)):
        w, x, y, z = qpos[n, q + 3], qpos[n, q + 4], qpos[n, q + 5], qpos[n, q + 6]
        to_base(qpos[n, q + 3 : q + 7], qvel[n, v : v + 3], out[n])
        out[n, 3], out[n, 4], out[n, 5] = qvel[n, v + 3], qvel[n, v + 4], qvel[n, v + 5]
        out[n, 6] = 2.0 * (w * y - x * z)
        out[n, 7] = -2.0 * (w * x + y * z)
        out[n, 8] = 2.0 * (x * x + y * y) - 1.0
        for i in range(joints):
            out[n, 9 + i] = qpos[n, joint_qpos[i]]
            out[n, 9 + joints + i] = qvel[n, joint_dof[i]]


@called()
def observe(body, default, command, clock, action, remembers, seen):
    """Write the observations (N, D) of N robots in the order of `layout`.

    Args:
        body: (N, `body_width`) see `true_body`.
        default: (J,) joint positions.
        command: (N, 3) vx, vy [m/s] and yaw rate [rad/s] in the base frame.
        clock: their `ClockState`; a standing robot sees (0, 0) for its phase.
        action: (N, P) the policy's last output.
        remembers: (N,) whether `seen` holds the step before; a robot that just started takes the
            present for its past. Set to true.
        seen: holds the observations of the step before.
    """
    _, phase, _, moving, _ = clock
    joints = (body.shape[1] - 9) // 2
    width, tail = 14 + 3 * joints, 3 * joints
    for n in range(len(body)):
        for i in range(9):
            seen[n, i] = body[n, i]
        for axis in range(3):
            seen[n, 9 + axis] = command[n, axis]
        angle = 2.0 * np.pi * phase[n]
        seen[n, 12] = np.sin(angle) if moving[n] else 0.0
        seen[n, 13] = np.cos(angle) if moving[n] else 0.0
        for i in range(seen.shape[1] - 1, width - 1, -1):
            seen[n, i] = seen[n, i - tail]
        for i in range(joints):
            seen[n, 14 + i] = body[n, 9 + i] - default[i]
            seen[n, 14 + joints + i] = body[n, 9 + joints + i]
            seen[n, 14 + 2 * joints + i] = action[n, i]
        if not remembers[n]:
            for i in range(width, seen.shape[1]):
                seen[n, i] = seen[n, i - tail]
            remembers[n] = True


@kernel()
def _true_bodies(qpos, qvel, places, out):
    true_body(qpos, qvel, places, out)
