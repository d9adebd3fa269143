"""The state of a robot from what its own sensors measure."""

from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....formats.core.arrays import Array, Mask
from ....formats.process.kernel import called, kernel
from ...robots import RobotHandles
from .gait import RATE_HZ
from .legs import GRAVITY_M_S2, Legs, cross, dot, foot_motion
from .observation import body_width

# Seconds over which feet that stay correct the attitude, fewer at the start, and the gyro's bias;
# and over which the gyro's mean is its bias, where joints and body are this slow.
TILT_S, FIRST_S, BIAS_S, REST_S = 1.0, 0.4, 10.0, 5.0
QUIET_RAD_S, LEVEL_RAD_S = 0.5, 0.05
# A foot counts as loaded from the first share of the robot's weight on, fully from the second.
LIGHT, LOADED = 0.1, 0.3
# Motors of a straight leg hardly feel its load: a foot counts for this much at least, if it is the
# lowest one, and 1/e as much for every further height above it [m].
LEAST, HIGHER_M = 0.1, 0.02
# Joints' velocities are differences of positions over a policy step by this share, the rest is what
# the motors report. Those are less noisy, but half a step old.
DIFFERENCE = 0.5
# Standard deviations [m/s]: of the velocity that the accelerometer gains in a policy step, of the
# skin of a foot that stands, and of a robot that is said to stand.
DRIFT_M_S, SKIN_M_S, FIRST_M_S = 0.01, 0.05, 0.1
DOUBT = 1.0 / 30.0  # of a foot that moves against all the rest: it slips, or is not on the ground


class Readings(NamedTuple):
    """What N robots measure, joints in the order of `RobotSpec.joint_names`.

    Attributes:
        joint_rad, joint_rad_s, torque_nm: (N, J) by encoders and motor currents.
        gyro_rad_s: (N, 3) the gyro's latest reading, in the base frame.
        turned_rad, gained_m_s: (N, 3) the integrals of gyro and accelerometer since the readings
            before, in the present base frame. A standing robot gains 0.2 m/s upwards in 20 ms.
    """

    joint_rad: Array
    joint_rad_s: Array
    torque_nm: Array
    gyro_rad_s: Array
    turned_rad: Array
    gained_m_s: Array

    @classmethod
    def zeros(cls, count: int, joints: int) -> "Readings":
        """Return readings of zero."""
        wide, vector = np.zeros((3, count, joints)), np.zeros((3, count, 3))
        return cls(*wide, *vector)


class _Memory(NamedTuple):
    """What the estimator remembers of N robots.

    Attributes:
        down: (N, 3) direction of gravity in the base frame; 0 before the first step.
        bias: (N, 3) of the gyro [rad/s].
        velocity: (N, 3) of the base, in its frame [m/s].
        joint_rad: (N, J) of the step before.
        variance: (N,) of each component of the velocity [m²/s²].
        age: (N,) since the start [s].
    """

    down: Array
    bias: Array
    velocity: Array
    joint_rad: Array
    variance: Array
    age: Array


class StateEstimator:
    """Estimates the bodies of N robots (see `true_body`) at 50 Hz: arrays in, arrays out.

    A loop on a real robot calls `update` with the readings of one robot; nothing here knows of a
    simulation but the constructor, which takes the legs' measures from a model.
    """

    def __init__(self, model: mujoco.MjModel, handles: RobotHandles, count: int) -> None:
        """Prepare estimates of `count` robots.

        Raises:
            InputError: the robot's legs are no chains of hinges with servos; see `Legs.of`.
        """
        self._legs = tuple(Legs.of(model, handles))
        self._body = np.zeros((count, body_width(handles.robot.policy_joints)))
        down, bias, velocity = np.zeros((3, count, 3))
        variance, age = np.zeros((2, count))
        joints = np.zeros((count, len(handles.joint_qpos)))
        self._memory = _Memory(down, bias, velocity, joints, variance, age)
        self._arrays = tuple(self._memory)

    @property
    def memory(self) -> tuple[NDArray[Any], ...]:
        """The arrays in which it keeps what it remembers between steps."""
        return self._arrays

    def reset(self, robots: NDArray[np.intp] | Mask | slice = slice(None)) -> None:
        """Forget some robots or all; they must stand when `update` is next called."""
        for array in self._arrays:
            array[robots] = 0.0

    def update(self, readings: Readings) -> Array:
        """Return bodies (N, `body_width`) after the next 20 ms, in memory that is used again."""
        _update(tuple(readings), self._legs, self._arrays, self._body)
        return self._body


@kernel()
def _update(readings, legs, memory, body):
    joint_rad, joint_rad_s, torque_nm, gyro, turned, gained = readings
    legs = Legs(*legs)
    downs, biases, velocities, befores, variances, ages = memory
    dt, feet = 1.0 / RATE_HZ, len(legs.joint)
    joints = (body.shape[1] - 9) // 2
    loads, heights = np.zeros(feet), np.zeros(feet)
    points, speeds = np.zeros((feet, 3)), np.zeros((feet, 3))
    turn, gain, lever, tilt = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    mean_rad_s = np.zeros(joint_rad.shape[1])
    for n in range(len(body)):
        down, bias, velocity = downs[n], biases[n], velocities[n]
        if ages[n] == 0.0:
            down[2], variances[n], befores[n] = -1.0, FIRST_M_S**2, joint_rad[n]
        ages[n] += dt
        resting = np.abs(joint_rad_s[n]).max() < QUIET_RAD_S
        resting &= np.abs(gyro[n] - bias).max() < LEVEL_RAD_S
        for i in range(3):
            if resting:
                bias[i] += dt / min(1.0 + ages[n], REST_S) * (gyro[n, i] - bias[i])
            turn[i] = turned[n, i] - dt * bias[i]
        _turn_back(turn, down)
        _turn_back(turn, velocity)
        for i in range(3):
            gain[i] = gained[n, i] + GRAVITY_M_S2 * dt * down[i]
            velocity[i] += gain[i]
            lever[i] = velocity[i]
        variances[n] += DRIFT_M_S**2
        for j in range(len(mean_rad_s)):
            moved = DIFFERENCE * (joint_rad[n, j] - befores[n, j]) / dt
            mean_rad_s[j] = moved + (1.0 - DIFFERENCE) * joint_rad_s[n, j]
            befores[n, j] = joint_rad[n, j]
        for f in range(feet):
            loads[f] = foot_motion(
                legs, f, joint_rad[n], mean_rad_s, torque_nm[n], down, points[f], speeds[f]
            )
            heights[f] = -dot(points[f], down)
        lowest = heights.min()
        for f in range(feet):
            share = min(max((loads[f] - LIGHT) / (LOADED - LIGHT), LEAST), 1.0)
            share *= np.exp((lowest - heights[f]) / HIGHER_M)
            _correct(turn, gain, points[f], speeds[f], share, velocity, variances, n)
        # What the feet correct is gravity in a wrong direction, for the most part.
        for i in range(3):
            lever[i] = (velocity[i] - lever[i]) / (
                GRAVITY_M_S2 * min(max(ages[n], FIRST_S), TILT_S)
            )
        cross(down, lever, tilt)
        for i in range(3):
            down[i] += lever[i]
            bias[i] += tilt[i] / BIAS_S
        size = np.sqrt(dot(down, down))
        for i in range(3):
            down[i] /= size
            body[n, i], body[n, 3 + i], body[n, 6 + i] = velocity[i], gyro[n, i] - bias[i], down[i]
        for i in range(joints):
            body[n, 9 + i], body[n, 9 + joints + i] = joint_rad[n, i], joint_rad_s[n, i]


@called()
def _turn_back(turn, vector):
    """Turn a vector by minus a small rotation vector, to the second order."""
    a, b, c = turn[0], turn[1], turn[2]
    x, y, z = vector[0], vector[1], vector[2]
    i, j, k = y * c - z * b, z * a - x * c, x * b - y * a
    vector[0] = x + i + 0.5 * (j * c - k * b)
    vector[1] = y + j + 0.5 * (k * a - i * c)
    vector[2] = z + k + 0.5 * (i * b - j * a)


@called()
def _correct(turn, gain, point, speed, share, velocity, variances, n):
    """Correct a velocity by that of a foot's skin, which counts for `share` of one that stands.

    By the share `DIFFERENCE` the foot tells the mean velocity of the last step, in which the base
    turned by `turn` and gained the velocity `gain`.
    """
    x, y, z = RATE_HZ * turn[0], RATE_HZ * turn[1], RATE_HZ * turn[2]
    apart = np.zeros(3)
    apart[0] = -speed[0] - (y * point[2] - z * point[1])
    apart[1] = -speed[1] - (z * point[0] - x * point[2])
    apart[2] = -speed[2] - (x * point[1] - y * point[0])
    for i in range(3):
        apart[i] -= velocity[i] - 0.5 * DIFFERENCE * gain[i]
    square = dot(apart, apart)
    spread = SKIN_M_S**2 / share
    spread += DOUBT * square * square / (spread + variances[n])
    trust = variances[n] / (variances[n] + spread)
    for i in range(3):
        velocity[i] += trust * apart[i]
    variances[n] *= 1.0 - trust
