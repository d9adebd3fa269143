"""Randomization of simulations: commands, bodies, friction, delays."""

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from ....formats.core.arrays import Array
from ...robots import RobotHandles
from .config import TrainingConfig

# Kinds of command and how often they come: a navigating robot mostly goes straight, turns on the
# spot, or does both at once, and stops in between.
KINDS = {"any": 0.40, "straight": 0.17, "turn": 0.17, "arc": 0.12, "stand": 0.14}

ACTION_S = 0.25  # of a discrete action in VLN-PE's timing
ACTIONS = np.array([(1.0, 0.0, 0.0), (0.0, 0.0, np.pi / 3), (0.0, 0.0, -np.pi / 3)])


def sample_commands(rng: np.random.Generator, count: int, bounds: Array) -> Array:
    """Return random commands (count, 3) within the bounds (3, 2); some axes are 0."""
    command = rng.uniform(bounds[:, 0], bounds[:, 1], (count, 3))
    kind = rng.choice(len(KINDS), count, p=list(KINDS.values()))
    mask = np.array([[1, 1, 1], [1, 0, 0], [0, 0, 1], [1, 0, 1], [0, 0, 0]])
    return command * mask[kind]


def sample_actions(rng: np.random.Generator, count: int) -> Array:
    """Return commands (count, 3) of discrete actions in VLN-PE's timing: half steps, half turns."""
    return ACTIONS[rng.choice(3, count, p=(0.5, 0.25, 0.25))]


def randomize_models(
    batch: Batch, handles: RobotHandles, config: TrainingConfig, rng: np.random.Generator
) -> Array:
    """Draw friction, masses, centre of mass and servo gains for every simulation, once.

    Returns:
        (N, 6) friction, mass scale, gain scale and shift of the centre of mass, for the critic.
    """
    n = batch.nsim
    friction = rng.uniform(*config.friction, n)
    mass = rng.uniform(*config.mass_scale, n)
    gain = rng.uniform(*config.gain_scale, n)
    shift = rng.uniform(-config.com_shift_m, config.com_shift_m, (n, 3))
    feet = batch.expand("geom_friction")
    feet[:, handles.sole_geoms.ravel(), 0] = friction[:, None]
    batch.expand("body_mass")[:] *= mass[:, None]
    batch.expand("body_inertia")[:] *= mass[:, None, None]
    batch.expand("body_ipos")[:, handles.root_body] += shift
    # Of a `dcmotor`, these are the gains kp and kd; its electrical constants stay.
    batch.expand("actuator_gainprm")[:, :, [4, 6]] *= gain[:, None, None]
    batch.set_const()
    return np.column_stack([friction, mass, gain, shift])


def draw_latency(rng: np.random.Generator, config: TrainingConfig) -> NDArray[np.intp]:
    """Return delays (N,) of the actions [physics steps], up to `latency_substeps`."""
    return rng.integers(0, config.latency_substeps + 1, config.envs)
