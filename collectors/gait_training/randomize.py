"""Bodies, gains and friction that differ from one simulation to the next."""

from __future__ import annotations

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from ..robots import RobotHandles
from .config import TrainingConfig


def randomize_models(
    batch: Batch, handles: RobotHandles, config: TrainingConfig, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw friction, masses, centre of mass and servo gains for every simulation, once.

    Returns:
        (N, 6) what was drawn (friction, mass scale, gain scale, shift of the centre of mass), for
        the critic's eyes only.
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
    """Delays of the actions [physics steps], (N,): most of up to 20 ms, some of up to 60 ms."""
    n = config.envs
    usual = rng.integers(0, config.latency_substeps + 1, n)
    late = rng.integers(0, config.late_substeps + 1, n)
    return np.where(rng.random(n) < config.late_share, late, usual)
