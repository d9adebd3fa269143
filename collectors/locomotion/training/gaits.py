"""The gait clocks of the robots."""

from collections.abc import Mapping
from typing import Any

from ...robots.g1.robot import G1
from ...robots.h1.robot import H1
from ..runtime.gait import GaitClock

Row = tuple[float, ...]

# How such gaits stop, lead into turns, and catch themselves; see `GaitClock`.
ON_FOUR_LEGS: dict[str, Any] = {"brake_m_s2": 4.0, "brake_rad_s2": 6.0, "last_steps": 1}
ON_TWO_LEGS: dict[str, Any] = {
    "turn_lead_s": 0.15,
    "brake_m_s2": 3.0,
    "brake_rad_s2": 4.0,
    "last_steps": 2,
    "catch_m_s": 0.25,
}


def _per_leg(hip: float, thigh: float, calf: float) -> tuple[tuple[float, ...], ...]:
    """Return rows of a block-diagonal (4, 12) matrix: each foot moves the joints of its leg."""
    leg = (hip, thigh, calf)
    return tuple((0.0,) * 3 * foot + leg + (0.0,) * 3 * (3 - foot) for foot in range(4))


# Diagonal pairs together (order FL, FR, RL, RR), each leg folding by thigh and calf.
TROT = GaitClock(
    frequency_hz=2.0,
    foot_offsets=(0.0, 0.5, 0.5, 0.0),
    stand_rad=(0.0, 0.04, 0.1) * 4,
    swing_rad=_per_leg(0.0, 0.25, -0.5),
    stance_rad=_per_leg(0.0, 0.0, 0.3),
    # A stance of 0.25 s under a leg of 0.33 m: 0.125 s × v / 0.33 m to either side.
    forward_rad=_per_leg(0.0, 0.38, 0.0),
    left_rad=_per_leg(-0.38, 0.0, 0.0),
    foot_xy_m=((0.24, 0.134), (0.24, -0.134), (-0.24, 0.134), (-0.24, -0.134)),
    lead_cycles=0.12,
    **ON_FOUR_LEGS,
)


def biped_walk(
    *,
    frequency_hz: float,
    joints: tuple[str, ...],
    sole_y_m: float,
    leg_m: float,
    stand: Mapping[str, float],
    stance: Mapping[str, float],
    swing_rad: float,
    reach: tuple[float, float],
    arm_swing: float,
    lead_cycles: float,
) -> GaitClock:
    """Return a walk for legs of hip, knee and ankle joints, named `<side>_<part>_joint`.

    The swing leg folds at hip and knee with its sole level; a stance of half a cycle under a leg of
    `leg_m` carries the foot by angles of v / (4 f leg) to either side.

    Args:
        frequency_hz: cycles (two steps) per second.
        joints: all joints of the robot, in order.
        sole_y_m: distance of each foot from the middle plane.
        leg_m: hip joint to sole.
        stand: part → joint offset [rad] of the left side that holds the standing robot's weight.
        stance: the same in the middle of a step, when one leg bears all of it.
        swing_rad: how far the hip folds at the top of a swing; the knee folds twice as much.
        reach: strides forward and sideways are longer by these factors, because servos give way.
        arm_swing: shoulder pitch over hip pitch, the arm going with the other side's leg.
        lead_cycles: see `GaitClock`.
    """
    stride, sidestep = (factor * 0.25 / (frequency_hz * leg_m) for factor in reach)
    ankle = "ankle_pitch" if "left_ankle_pitch_joint" in joints else "ankle"

    def row(side: str, parts: Mapping[str, float]) -> Row:
        offsets = {f"{side}_{part}_joint": value for part, value in parts.items()}
        return tuple(offsets.get(name, 0.0) for name in joints)

    def alike(parts: Mapping[str, float]) -> tuple[Row, Row]:
        return row("left", parts), row("right", parts)

    def mirrored(parts: Mapping[str, float]) -> tuple[Row, Row]:
        # A reflection of y reverses turns about x and z.
        other = {k: -v if k.endswith(("roll", "yaw")) else v for k, v in parts.items()}
        return row("left", parts), row("right", other)

    return GaitClock(
        frequency_hz=frequency_hz,
        foot_offsets=(0.0, 0.5),
        stand_rad=tuple(left + right for left, right in zip(*mirrored(stand), strict=True)),
        swing_rad=alike({"hip_pitch": -swing_rad, "knee": 2.0 * swing_rad, ankle: -swing_rad}),
        stance_rad=mirrored(stance),
        forward_rad=alike(
            {"hip_pitch": stride, "shoulder_pitch": -arm_swing * stride, ankle: -stride}
        ),
        left_rad=alike({"hip_roll": -sidestep, "ankle_roll": sidestep}),
        foot_xy_m=((0.0, sole_y_m), (0.0, -sole_y_m)),
        lead_cycles=lead_cycles,
        turn_rad=alike({"hip_yaw": -0.25 / frequency_hz}),
        **ON_TWO_LEGS,
    )


# Offsets that hold the weight are joint torques of the static pose over the servos' stiffness.
WALK_H1 = biped_walk(
    frequency_hz=1.4,
    joints=H1.joint_names,
    sole_y_m=0.2,
    leg_m=0.86,
    stand={"hip_roll": -0.111, "hip_pitch": 0.03, "knee": -0.121, "ankle": 0.115},
    stance={"hip_roll": -0.1, "knee": -0.1},
    swing_rad=0.32,
    reach=(1.1, 1.4),
    arm_swing=1.2,
    lead_cycles=0.08,
)
WALK_G1 = biped_walk(
    frequency_hz=1.6,
    joints=G1.joint_names,
    sole_y_m=0.118,
    leg_m=0.67,
    stand={"knee": -0.01, "ankle_pitch": 0.12},
    stance={"hip_roll": -0.05, "knee": -0.03},
    swing_rad=0.3,
    reach=(1.4, 1.3),
    arm_swing=1.2,
    lead_cycles=0.14,
)

GAITS: dict[str, GaitClock] = {"aliengo": TROT, "h1": WALK_H1, "g1": WALK_G1}
