"""The Rollout record: physics truth of one episode, sampled at 100 Hz, no pixels."""

import math
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum

import numpy as np

from .arrays import I64, Array, Mask
from .episode import Episode

STATE_RATE_HZ = 100  # divisible by 4, 5, 10, 20, 25 and 50: every frame time is a sample
DISCRETE_RATE_HZ = 4  # a discrete action takes 0.25 s in VLN-PE's timing
REST_M_S = 0.05  # a base slower than this is at rest
DAGGER = "dagger"  # controller of a walk that a policy and the expert share
HUMAN = "human"  # controller of a drive of a person
REST_EVENT = "rest"  # kind of the event at which a stopped robot came to rest
FORWARD_STEP_M = 0.25
TURN_STEP_RAD = math.radians(15.0)


class Action(IntEnum):
    """VLN-CE's discrete actions: forward 0.25 m, turns of 15°."""

    STOP = 0
    FORWARD = 1
    LEFT = 2
    RIGHT = 3


# What an action does, Δx, Δy [m] and Δyaw [rad] in the frame of the pose before.
STEPS = {
    Action.FORWARD: (FORWARD_STEP_M, 0.0, 0.0),
    Action.LEFT: (0.0, 0.0, TURN_STEP_RAD),
    Action.RIGHT: (0.0, 0.0, -TURN_STEP_RAD),
}


class EndReason(StrEnum):
    """Why an episode ended.

    `SUCCESS` is the strict one of collection. A stop farther from the goal, but within its radius,
    `STOPPED_NEAR`, is a success in VLN's sense only (`Metrics.success`).
    """

    SUCCESS = "success"
    STOPPED_NEAR = "stopped_near"
    STOPPED_FAR = "stopped_far"
    FALL = "fall"
    STUCK = "stuck"
    TIMEOUT = "timeout"
    COLLISION_START = "collision_start"
    DIVERGED = "diverged"


@dataclass(frozen=True)
class ActionSpan:
    """One executed discrete action and the sample interval [start, stop) it took."""

    action: Action
    start_sample: int
    stop_sample: int


@dataclass(frozen=True)
class Event:
    """An event: a contact with an obstacle, a re-plan or a fall."""

    time_s: float
    kind: str
    detail: str = ""


@dataclass(frozen=True)
class Metrics:
    """VLN metrics of one rollout (Anderson et al. 2018; nDTW: Ilharco et al. 2019).

    Distances to the goal are geodesic on the freemap unless named otherwise. `fall` follows the
    VLN-PE paper, at an instant; for falls `recovered` says whether the robot stood up by itself (it
    was up for the second half of the second behind it), `down` whether it was down a second later.
    """

    trajectory_length_m: float
    navigation_error_m: float
    navigation_error_euclidean_m: float
    success: bool
    oracle_success: bool
    spl: float
    ndtw: float
    fall: bool
    stuck: bool
    duration_s: float
    recovered: bool = False
    down: bool = False


@dataclass(frozen=True)
class Rollout:
    """State of the robot at every sample, and what it did.

    T samples at `STATE_RATE_HZ`; sample 0 is the first after settling.

    Attributes:
        robot, controller: registry names.
        time_s: (T,) [s].
        position_world_m: (T, 3) base position [m].
        quat_wxyz: (T, 4) base orientation in the world.
        linear_velocity_base_m_s: (T, 3) in the base frame.
        angular_velocity_base_rad_s: (T, 3) in the base frame.
        joint_names: J names, the order of the next three.
        joint_position_rad, joint_velocity_rad_s, joint_torque_nm: (T, J).
        command: (T, 3) commanded vx, vy [m/s] and yaw rate [rad/s], in the base frame.
        foot_names: F names.
        foot_contact: (T, F) bool.
        foot_force_n: (T, F) normal force of the ground on each foot [N]; NaN where not recorded.
        imu: (T, 6) specific force [m/s²] and angular rate [rad/s] in the base frame.
        floor_z_m: (T,) height of the floor under the base [m].
        actions: executed discrete actions; empty when the controller knows none.
        events: in time order.
        facts: robot, physics and controller facts worth keeping with the data (JSON values).
        labels: where the controller knows no discrete actions, the one that VLN-CE's expert would
            take toward the reference path at every 25th sample (`DISCRETE_RATE_HZ`). In a walk of
            `vlnpe dagger`, the expert's action at each of `actions`.
    """

    episode: Episode
    robot: str
    controller: str
    time_s: Array
    position_world_m: Array
    quat_wxyz: Array
    linear_velocity_base_m_s: Array
    angular_velocity_base_rad_s: Array
    joint_names: tuple[str, ...]
    joint_position_rad: Array
    joint_velocity_rad_s: Array
    joint_torque_nm: Array
    command: Array
    foot_names: tuple[str, ...]
    foot_contact: Mask
    foot_force_n: Array
    imu: Array
    floor_z_m: Array
    actions: tuple[ActionSpan, ...]
    events: tuple[Event, ...]
    end_reason: EndReason
    metrics: Metrics
    facts: dict[str, object] = field(default_factory=dict)
    labels: tuple[Action, ...] = ()

    def frame_samples(self, frames_per_second: int) -> I64:
        """Return the sample index (N,) of each frame: every 100/fps-th sample from 0 on.

        If the robot came to rest after STOP, frames end at the first one at rest.

        Raises:
            ValueError: when the rate does not divide `STATE_RATE_HZ`.
        """
        if frames_per_second < 1 or STATE_RATE_HZ % frames_per_second:
            valid = [r for r in range(1, STATE_RATE_HZ + 1) if STATE_RATE_HZ % r == 0]
            raise ValueError(f"frame rate {frames_per_second} does not divide 100; valid: {valid}")
        every, stop = STATE_RATE_HZ // frames_per_second, len(self.time_s)
        rest = [round(e.time_s * STATE_RATE_HZ) for e in self.events if e.kind == REST_EVENT]
        if rest:
            stop = min(stop, math.ceil(rest[-1] / every) * every + 1)
        return np.arange(0, stop, every)
