"""A simulated robot's own sensors, with the errors of real ones."""

from dataclasses import astuple, dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....formats.core.arrays import Array, Mask
from ....formats.process.kernel import called, kernel
from ...robots import RobotHandles
from .estimator import Readings
from .gait import RATE_HZ
from .legs import GRAVITY_M_S2
from .observation import to_base


@dataclass(frozen=True)
class SensorErrors:
    """Standard deviations of sensors' noise at 50 Hz, and of biases, drawn at every start.

    Unitree does not name its inertial sensor; this one is like Bosch's BMI088 (data sheet: 0.014
    °/s/√Hz and ±1 °/s; 0.175 mg/√Hz and ±20 mg) with a bandwidth of 100 Hz. As real ones do, it
    integrates at its own rate: no vibration is missed between two readings. The offset of a joint's
    zero is the noise of joint positions in legged_gym and unitree_rl_gym, 0.01 rad; encoders of 15
    bits hardly err beyond it. Joint velocities are differences over 2 ms, torques come from
    currents. The bus runs at 500 Hz; with its loop, what it delivers is a physics step old.

    Attributes:
        joint_rad, joint_offset_rad: of joint positions.
        joint_rad_s: of joint velocities.
        torque_nm, torque_share: of torques, and of their scale.
        gyro_rad_s, gyro_bias_rad_s: of turn rates.
        accelerometer_m_s2, accelerometer_bias_m_s2: of the specific force.
        late_s: age of encoders' readings, up to 20 ms; torques and turn rates are as old in MuJoCo
            itself.
    """

    joint_rad: float = 0.0005
    joint_offset_rad: float = 0.01
    joint_rad_s: float = 0.1
    torque_nm: float = 0.5
    torque_share: float = 0.05
    gyro_rad_s: float = 0.0025
    gyro_bias_rad_s: float = 0.0087
    accelerometer_m_s2: float = 0.017
    accelerometer_bias_m_s2: float = 0.1
    late_s: float = 0.005


class Simulation(NamedTuple):
    """Memory of N simulations: (N, nq), (N, nv), (N, …) sensors and (N, …) actuator forces."""

    qpos: Array
    qvel: Array
    sensordata: Array
    actuator_force: Array


class Sensors:
    """Reads the sensors of N robots. The same seeds give the same errors.

    Attributes:
        readings: as of the last `read`.
    """

    def __init__(
        self, simulation: Simulation, handles: RobotHandles, errors: SensorErrors, seed: int = 0
    ) -> None:
        """Prepare the sensors.

        Args:
            simulation: read in every step.
            handles: addresses of the robot in it.
            errors: of the sensors.
            seed: of the errors; every robot has its own.
        """
        count, joints = len(simulation.qpos), len(handles.joint_qpos)
        self._places = (
            *simulation, handles.joint_qpos, handles.joint_dof, handles.actuators,
            handles.root_qpos, handles.root_dof, handles.gyro,
        )  # fmt: skip
        self._errors = astuple(errors)
        self.readings = Readings.zeros(count, joints)
        self._readings = tuple(self.readings)
        self._ticks, self._before = np.zeros(count, dtype=np.int64), np.zeros((2, count, joints))
        self._base = np.zeros((count, 7))
        self.seeds = np.zeros(count, dtype=np.int64)
        self.reseed(seed)

    def reseed(self, seed: int) -> None:
        """Draw other errors from now on."""
        rng = np.random.default_rng(seed)
        self.seeds[:] = rng.integers(2**62, size=len(self.seeds))

    @property
    def memory(self) -> tuple[NDArray[Any], ...]:
        """The arrays in which they keep what they remember between steps."""
        return self._ticks, self._before, self._base, self.seeds

    def reset(self, robots: NDArray[np.intp] | Mask | slice = slice(None)) -> None:
        """Start some robots again, or all."""
        self._ticks[robots] = 0

    def read(self) -> Readings:
        """Return the present readings, in memory that is used again."""
        memory = self._ticks, self._before, self._base, self.seeds
        _read(self._places, self._errors, memory, self._readings)
        return self.readings


@kernel()
def _read(places, errors, memory, readings):
    qpos, qvel, sensordata, force, joint_qpos, joint_dof, actuators, root, dof, gyro_at = places
    ticks, before, base, seeds = memory
    noise_rad, offset_rad, noise_rad_s, noise_nm, share = errors[:5]
    gyro, gyro_bias, specific, specific_bias, late_s = errors[5:]
    joint_rad, joint_rad_s, torque_nm, rates, turned, gained = readings
    late, dt, joints = late_s * RATE_HZ, 1.0 / RATE_HZ, len(joint_qpos)
    turn, gain = np.zeros(3), np.zeros(3)
    for n in range(len(qpos)):
        seed, tick = seeds[n], ticks[n] + 1
        ticks[n] = tick
        quat, velocity = qpos[n, root + 3 : root + 7], qvel[n, dof : dof + 3]
        if tick == 1:
            _keep(quat, velocity, base[n])
            for j in range(joints):
                before[0, n, j], before[1, n, j] = qpos[n, joint_qpos[j]], qvel[n, joint_dof[j]]
        _moved(base[n, :4], quat, turn)
        for i in range(3):
            gain[i] = velocity[i] - base[n, 4 + i]
        gain[2] += GRAVITY_M_S2 * dt
        to_base(quat, gain, gained[n])
        for i in range(3):
            lasting = gyro_bias * _normal(seed, 0, 5 * i + 3)
            rates[n, i] = (
                sensordata[n, gyro_at + i] + lasting + gyro * _normal(seed, tick, 5 * i + 3)
            )
            turned[n, i] = turn[i] + dt * (lasting + gyro * _normal(seed, tick, 5 * i + 18))
            gained[n, i] += dt * (
                specific_bias * _normal(seed, 0, 5 * i + 4)
                + specific * _normal(seed, tick, 5 * i + 4)
            )
        _keep(quat, velocity, base[n])
        for j in range(joints):
            place, speed = qpos[n, joint_qpos[j]], qvel[n, joint_dof[j]]
            joint_rad[n, j] = place + late * (before[0, n, j] - place)
            joint_rad[n, j] += offset_rad * _normal(seed, 0, 5 * j)
            joint_rad[n, j] += noise_rad * _normal(seed, tick, 5 * j)
            joint_rad_s[n, j] = speed + late * (before[1, n, j] - speed)
            joint_rad_s[n, j] += noise_rad_s * _normal(seed, tick, 5 * j + 1)
            torque_nm[n, j] = force[n, actuators[j]] * (1.0 + share * _normal(seed, 0, 5 * j + 2))
            torque_nm[n, j] += noise_nm * _normal(seed, tick, 5 * j + 2)
            before[0, n, j], before[1, n, j] = place, speed


@called()
def _keep(quat, velocity, base):
    for i in range(4):
        base[i] = quat[i]
    for i in range(3):
        base[4 + i] = velocity[i]


@called()
def _moved(old, new, out):
    """Write the rotation vector between two orientations, in the frame of either."""
    w = old[0] * new[0] + old[1] * new[1] + old[2] * new[2] + old[3] * new[3]
    out[0] = old[0] * new[1] - old[1] * new[0] - old[2] * new[3] + old[3] * new[2]
    out[1] = old[0] * new[2] - old[2] * new[0] - old[3] * new[1] + old[1] * new[3]
    out[2] = old[0] * new[3] - old[3] * new[0] - old[1] * new[2] + old[2] * new[1]
    sine = np.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)
    factor = 2.0 if sine < 1e-9 else 2.0 * np.arctan2(sine, abs(w)) / sine
    for i in range(3):
        out[i] *= factor if w > 0.0 else -factor


@called()
def _normal(seed, tick, channel):
    """Return a standard normal number that depends on nothing but the arguments (SplitMix64)."""
    z = np.uint64(seed) + np.uint64(tick * 1024 + channel + 1) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z ^= z >> np.uint64(31)
    radius = np.sqrt(-2.0 * np.log((np.float64(z >> np.uint64(32)) + 1.0) / 4294967296.0))
    return radius * np.cos(2.0 * np.pi * np.float64(z & np.uint64(0xFFFFFFFF)) / 4294967296.0)
