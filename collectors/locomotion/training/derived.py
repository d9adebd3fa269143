"""The gait of a user's own robot, derived from its model and its rhythm alone.

A reference motion needs, for each foot, the joint offsets that lift it and those that carry it
along under the body. Both follow from the legs' kinematics; what holds the weight follows from
statics and the servos' stiffness.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....formats.core.arrays import Array
from ....formats.core.errors import InputError
from ...robots import RobotHandles, RobotSpec
from ..runtime.gait import RATE_HZ, GaitClock
from .gaits import ON_FOUR_LEGS, ON_TWO_LEGS

G_M_S2 = 9.81
LIFT = 1.2  # the reference lifts a foot by this much more than it shall rise, because servos lag
TURN_M = 0.2  # a foot's turn by 1 rad counts as much as a displacement by this
ROUNDS, DAMPING, STEP_RAD = 20, 1e-4, 0.3
# Legs of more joints than this can hold their soles level.
POINT_LEG = 3
PITCHES = 0.9  # share of a joint's axis that is sideways, to count as one that pitches


@dataclass(frozen=True)
class Leg:
    """A foot: the body that it is part of, and the joints between it and the base.

    Attributes:
        columns: indices of its joints among the robot's.
        soles: geoms of its soles.
        place_m: (3,) middle of its soles' lowest points in the default pose, world frame.
        press_m: (3,) where it presses; a long sole does so below the centre of mass.
    """

    body: int
    columns: NDArray[np.intp]
    soles: NDArray[np.intp]
    place_m: Array
    press_m: Array


class Stance:
    """A robot in its default pose, its base held fixed at the origin."""

    def __init__(self, robot: RobotSpec) -> None:
        """Build the model.

        Raises:
            InputError: a foot is not moved by any joint.
        """
        self.robot = robot
        self.model = robot.build_model(floor=False)
        self.data = mujoco.MjData(self.model)
        self.handles = RobotHandles.find(robot, self.model)
        self._reset()
        self.legs = [self._leg(foot) for foot in range(len(robot.feet))]
        self.kp = np.array([joint.kp for joint in robot.joints])

    def _reset(self) -> None:
        self.handles.spawn(self.data)
        mujoco.mj_forward(self.model, self.data)

    def _leg(self, foot: int) -> Leg:
        soles = self.handles.sole_geoms[foot]
        place = self.data.geom_xpos[soles].mean(axis=0)
        place[2] -= self.handles.sole_radius_m[foot].mean()
        body = over = int(self.model.geom_bodyid[soles[0]])
        chain = set()
        while over:
            chain.add(over)
            over = int(self.model.body_parentid[over])
        owners = self.model.dof_bodyid[self.handles.joint_dof[: self.robot.policy_joints]]
        columns = np.flatnonzero([owner in chain for owner in owners])
        if not len(columns):
            name = self.robot.feet[foot].name
            raise InputError(f"robot {self.robot.name}: no joint of the policy moves foot {name}")
        return Leg(body, columns, soles, place, self._press_m(soles, place))

    def _press_m(self, soles: NDArray[np.intp], place_m: Array) -> Array:
        """Return (3,) where soles at a place press: below the centre of mass if they reach it."""
        along = self.data.geom_xpos[soles, 0]
        return np.array([np.clip(self._center_m[0], along.min(), along.max()), *place_m[1:]])

    @property
    def _center_m(self) -> Array:
        return self.data.subtree_com[self.handles.root_body]

    def jacobian(self, body: int, place_m: Array) -> Array:
        """Return (6, J) how all joints move and turn a body at a place, in the pose at hand."""
        move, turn = np.zeros((3, self.model.nv)), np.zeros((3, self.model.nv))
        mujoco.mj_jac(self.model, self.data, move, turn, place_m, body)
        return np.vstack([move, turn])[:, self.handles.joint_dof]

    def reach(self, leg: Leg, shift_m: Array, yaw_rad: float = 0.0) -> Array:
        """Return offsets (J,) of a leg's joints [rad] that shift and turn its foot (Newton steps).

        A leg of three joints or fewer does not mind how its foot is turned.
        """
        offsets = self._bend(leg, shift_m, yaw_rad)
        self._reset()
        return offsets

    def reach_and_bear(self, leg: Leg, shift_m: Array) -> tuple[Array, Array]:
        """Return the offsets of `reach`, and how much farther (J,) [rad] servos must aim there.

        That holds when the leg alone bears the robot, rather than in the default pose.
        """
        before = self.push(leg)
        offsets = self._bend(leg, shift_m)
        press = self._press_m(leg.soles, leg.place_m + shift_m)
        push = -self.jacobian(leg.body, press)[2] - before
        self._reset()
        return offsets, push * self.robot.mass_kg * G_M_S2 / self.kp

    def _bend(self, leg: Leg, shift_m: Array, yaw_rad: float = 0.0) -> Array:
        """Bend a leg; return its joints' offsets (J,) [rad]."""
        data, joints = self.data, self.handles.joint_qpos[leg.columns]
        local = data.xmat[leg.body].reshape(3, 3).T @ (leg.place_m - data.xpos[leg.body])
        start = data.xquat[leg.body].copy()
        spin = np.zeros(4)
        mujoco.mju_axisAngle2Quat(spin, np.array([0.0, 0.0, 1.0]), yaw_rad)
        goal = np.zeros(4)
        mujoco.mju_mulQuat(goal, spin, start)
        for _ in range(ROUNDS):
            now = data.xpos[leg.body] + data.xmat[leg.body].reshape(3, 3) @ local
            back, away, turn = np.zeros(4), np.zeros(4), np.zeros(3)
            mujoco.mju_negQuat(back, data.xquat[leg.body])
            mujoco.mju_mulQuat(away, goal, back)
            mujoco.mju_quat2Vel(turn, away, 1.0)
            jacobian = self.jacobian(leg.body, now)[:, leg.columns]
            error = np.concatenate([leg.place_m + shift_m - now, TURN_M * turn])
            jacobian[3:] *= TURN_M
            if len(leg.columns) <= POINT_LEG:
                jacobian, error = jacobian[:3], error[:3]
            square = jacobian.T @ jacobian + DAMPING * np.eye(len(leg.columns))
            step = np.linalg.solve(square, jacobian.T @ error)
            # Long legs are nearly straight: a whole step would fold them backwards.
            data.qpos[joints] += step * min(1.0, STEP_RAD / np.abs(step).max(initial=STEP_RAD))
            mujoco.mj_kinematics(self.model, data)
            mujoco.mj_comPos(self.model, data)
        offsets = np.zeros(len(self.kp))
        offsets[leg.columns] = data.qpos[joints] - self.robot.default_joint_rad[leg.columns]
        return offsets

    def pitch_anchors_m(self, leg: Leg) -> Array:
        """Return where the pitch joints of a leg are in the default pose, (n, 3) [m]."""
        joints = self.model.dof_jntid[self.handles.joint_dof[leg.columns]]
        joints = joints[np.abs(self.data.xaxis[joints, 1]) > PITCHES]
        return self.data.xanchor[joints].copy()

    def sole_m(self, leg: Leg) -> float:
        """Return how long a leg's sole is [m]."""
        return float(np.ptp(self.data.geom_xpos[leg.soles, 0]))

    def lift_m(self, leg: Leg, offsets_rad: Array) -> float:
        """Return how much joint offsets (J,) raise a leg's foot [m]."""
        local = self.data.xmat[leg.body].reshape(3, 3).T @ (leg.place_m - self.data.xpos[leg.body])
        self.data.qpos[self.handles.joint_qpos] += offsets_rad
        mujoco.mj_kinematics(self.model, self.data)
        place = self.data.xpos[leg.body] + self.data.xmat[leg.body].reshape(3, 3) @ local
        self._reset()
        return float(place[2] - leg.place_m[2])

    def slope(self, leg: Leg, motion: Array) -> Array:
        """Return offsets (J,) [rad] per unit of a foot's motion (4,): x, y, z [m] and yaw [rad].

        They are taken from half the motion to either side.
        """
        both = [self.reach(leg, sign * motion[:3], sign * motion[3]) for sign in (0.5, -0.5)]
        return both[0] - both[1]

    def sag(self, loads_n: Array) -> Array:
        """Return how much higher (J,) [rad] servos must aim to bear the feet's loads (F,) [N]."""
        torque = self.data.qfrc_bias[self.handles.joint_dof].copy()
        for leg, load in zip(self.legs, loads_n, strict=True):
            torque += self.push(leg) * load
        return torque / self.kp

    def push(self, leg: Leg) -> Array:
        """Return joint torques (J,) [Nm] with which a foot presses down with 1 N."""
        return -self.jacobian(leg.body, leg.press_m)[2]

    def loads_n(self) -> Array:
        """Return the feet's loads (F,) [N] that balance the standing robot, as even as possible."""
        place = np.array([leg.place_m for leg in self.legs])
        center = self._center_m
        rows = np.vstack([np.ones(len(place)), place[:, 0], place[:, 1]])
        weight = self.robot.mass_kg * G_M_S2
        loads, *_ = np.linalg.lstsq(rows, weight * np.array([1.0, *center[:2]]), rcond=None)
        return np.maximum(loads, 0.0)


def derived_gait(robot: RobotSpec) -> GaitClock:
    """Return the gait clock and reference motion of a robot with a `rhythm`.

    Raises:
        InputError: the robot has no rhythm, or a foot that no joint moves.
    """
    rhythm = robot.rhythm
    if rhythm is None:
        raise InputError(
            f"robot {robot.name} does not say how it steps; valid: a table [gait] in robot.toml "
            "with frequency_hz and foot_offsets"
        )
    stance = Stance(robot)
    loads, legs = stance.loads_n(), stance.legs
    up = np.array([0.0, 0.0, LIFT * rhythm.swing_height_m])
    # A foot on the ground for half a cycle is carried by v / (4 f) to either side, and at the
    # start of its swing it is as far behind.
    back = -0.25 / rhythm.frequency_hz
    x, y, yaw = np.eye(4)[[0, 1, 3]] * back
    lag_s = np.mean([joint.kd / joint.kp for joint in robot.joints[: robot.policy_joints]])
    turns = [stance.slope(leg, yaw) for leg in legs if len(leg.columns) > POINT_LEG]
    return GaitClock(
        frequency_hz=rhythm.frequency_hz,
        foot_offsets=rhythm.foot_offsets,
        stand_rad=_row(stance.sag(loads)),
        swing_rad=tuple(_row(stance.reach(leg, up)) for leg in legs),
        # In the middle of a step, half of the feet bear everything.
        stance_rad=tuple(
            _row(stance.push(leg) * load / stance.kp) for leg, load in zip(legs, loads, strict=True)
        ),
        forward_rad=tuple(_row(stance.slope(leg, x)) for leg in legs),
        left_rad=tuple(_row(stance.slope(leg, y)) for leg in legs),
        foot_xy_m=tuple((float(leg.place_m[0]), float(leg.place_m[1])) for leg in legs),
        turn_rad=tuple(_row(turn) for turn in turns) if len(turns) == len(legs) else (),
        lead_cycles=float(rhythm.frequency_hz * (lag_s + 1.0 / RATE_HZ)),
        **(ON_TWO_LEGS if len(legs) == 2 else ON_FOUR_LEGS),
    )


def _row(values: Array) -> tuple[float, ...]:
    return tuple(round(float(value), 4) for value in values)
