"""Reward of one policy step, for many simulations at once."""

from dataclasses import dataclass

import numpy as np

from ....formats.core.arrays import Array, Mask
from .config import TrainingConfig

SMOOTHNESS_TERMS = frozenset(
    {"torque", "joint_acceleration", "action_rate", "action_jerk", "roll_pitch_rate"}
)


@dataclass(frozen=True)
class StepFacts:
    """Outcome of one policy step; N simulations, J joints, F feet.

    Velocities are in the base frame; `*_mean` are running means over about half a gait cycle,
    because the gait itself makes the velocity swing.
    """

    command: Array  # (N, 3)
    moving: Mask  # (N,)
    linear_velocity: Array  # (N, 3)
    angular_velocity: Array  # (N, 3)
    linear_mean: Array  # (N, 2)
    yaw_mean: Array  # (N,)
    gravity: Array  # (N, 3)
    height_m: Array  # (N,) base above the ground
    torque_nm: Array  # (N, J)
    joint_rad: Array  # (N, J)
    joint_rad_s: Array  # (N, J)
    joint_acceleration: Array  # (N, J)
    action: Array  # (N, J)
    previous_action: Array
    older_action: Array
    foot_phase: Array  # (N, F) in cycles, swing below one half
    foot_contact: Mask  # (N, F)
    foot_height_m: Array  # (N, F) sole above the ground
    foot_speed_m_s: Array  # (N, F) horizontal


@dataclass(frozen=True)
class BodyFacts:
    """Constants of the robot that the reward needs."""

    base_height_m: float
    default_joint_rad: Array  # (J,)
    stand_joint_rad: Array  # (J,)
    joint_range_rad: Array  # (J, 2)
    sideways: Mask  # (J,) joints about other axes than y


def _closeness(squared_error: Array, widths: tuple[float, ...]) -> Array:
    """Return 1 without error; a wide bell pulls from afar, a narrow one asks for precision."""
    return np.mean([np.exp(-squared_error / width) for width in widths], axis=0)


def reward_terms(s: StepFacts, body: BodyFacts, config: TrainingConfig) -> dict[str, Array]:
    """Return the unweighted terms by name of `RewardWeights`, each (N,)."""
    linear_error = np.sum((s.linear_velocity[:, :2] - s.command[:, :2]) ** 2, axis=1)
    linear_mean_error = np.sum((s.linear_mean - s.command[:, :2]) ** 2, axis=1)
    yaw_error = (s.angular_velocity[:, 2] - s.command[:, 2]) ** 2
    yaw_mean_error = (s.yaw_mean - s.command[:, 2]) ** 2

    swing = (s.foot_phase < 0.5) & s.moving[:, None]
    arc = config.swing_height_m * np.sin(2.0 * np.pi * np.minimum(s.foot_phase, 0.5))
    low, high = body.joint_range_rad.T
    margin = 0.05
    beyond = np.maximum(low + margin - s.joint_rad, 0) + np.maximum(s.joint_rad - high + margin, 0)
    still = ~s.moving
    return {
        "track_linear": np.exp(-linear_error / 0.25),
        "track_yaw": _closeness(yaw_error, config.yaw_widths),
        "track_linear_mean": _closeness(linear_mean_error, config.linear_mean_widths),
        "track_yaw_mean": _closeness(yaw_mean_error, config.yaw_mean_widths),
        "alive": np.ones(len(s.moving)),
        "vertical_velocity": s.linear_velocity[:, 2] ** 2,
        "roll_pitch_rate": np.sum(s.angular_velocity[:, :2] ** 2, axis=1),
        "tilt": np.sum(s.gravity[:, :2] ** 2, axis=1),
        "base_height": (s.height_m - body.base_height_m) ** 2,
        "torque": np.sum(s.torque_nm**2, axis=1),
        "joint_acceleration": np.sum(s.joint_acceleration**2, axis=1),
        "action_rate": np.sum((s.action - s.previous_action) ** 2, axis=1),
        "action_jerk": np.sum((s.action - 2 * s.previous_action + s.older_action) ** 2, axis=1),
        "contact_schedule": np.mean(s.foot_contact != swing, axis=1),
        "swing_height": np.sum(np.minimum(s.foot_height_m - arc, 0.0) ** 2 * swing, axis=1)
        + config.high_swing * np.sum(np.maximum(s.foot_height_m - arc, 0.0) ** 2, axis=1),
        "foot_slip": np.sum(np.minimum(s.foot_speed_m_s, 1.0) ** 2 * s.foot_contact, axis=1),
        "sideways": np.sum((s.joint_rad - body.default_joint_rad)[:, body.sideways] ** 2, axis=1),
        "stand_pose": np.sum(np.abs(s.joint_rad - body.stand_joint_rad), axis=1) * still,
        "stand_joint_velocity": np.sum(s.joint_rad_s**2, axis=1) * still,
        "joint_limit": np.sum(beyond, axis=1),
    }
