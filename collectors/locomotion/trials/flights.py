"""Flights of stairs: how many robots get up and down them under the product's own controller."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...controllers import PathConfig
from ...controllers.path import PathController
from ...physics.outcome import OutcomeConfig
from ...robots import POLICY_DECIMATION
from ..runtime.policy import GaitPolicy
from .driven import Drivers, tasks_along
from .terrain import stairs_terrain
from .trial import Conditions, Trial

RISERS_M = (0.10, 0.13, 0.15, 0.17, 0.18)
HARD_RISERS_M = (0.15, 0.17)
GOINGS_M = (0.26, 0.28, 0.30)
STEPS = 8  # risers of a flight
CRUISE_M_S = 0.4
ASIDE_M, ASKEW_RAD = 0.4, np.deg2rad(10.0)  # how robots stand before a flight, at most
WALK_M = 0.8  # before it, and on behind it


def flights(
    policy: GaitPolicy,
    count: int,
    rng: np.random.Generator,
    risers_m: Sequence[float] = RISERS_M,
    hard_risers_m: Sequence[float] = HARD_RISERS_M,
) -> dict[str, dict[str, float]]:
    """Return what `climb` does for every riser, by the part's name in an evaluation table."""
    return {f"flights_{100 * r:g}cm": climb(policy, r, count, rng) for r in risers_m} | {
        f"flights_{100 * r:g}cm_hard": climb(policy, r, count, rng, hard=True)
        for r in hard_risers_m
    }


def climb(
    policy: GaitPolicy, riser_m: float, count: int, rng: np.random.Generator, hard: bool = False
) -> dict[str, float]:
    """Let `count` robots go up, and as many down, a flight of `STEPS` risers.

    Treads of all `GOINGS_M` occur, friction is 0.5–1.1, every second robot acts 20 ms late, and the
    ground that a footing sees is the true one. `hard` means friction 0.6, all late, and a map with
    the errors of a depth camera. A robot has arrived if it stopped `WALK_M` behind
    the flight and 2.5 s later still stands there.

    Returns:
        Flights in each direction, shares that arrived, falls, and how much of the way the robots
        walked on average.
    """
    terrain = stairs_terrain([riser_m] * len(GOINGS_M), GOINGS_M, STEPS, hills=1)
    up = np.arange(2 * count) < count
    paths = []
    for i, upwards in enumerate(up):
        lane = terrain.lanes[i % len(GOINGS_M)]
        run = (STEPS - 1) * lane.going_m
        begin = lane.foot_m[0] if upwards else lane.head_m[0] - run
        x = np.array([begin - WALK_M, begin + run + WALK_M])
        y = lane.y_m + rng.uniform(-ASIDE_M, ASIDE_M)
        paths.append(np.column_stack([x, np.full(2, y)]))
    starts, goals = np.array(paths).transpose(1, 0, 2)
    heading = rng.uniform(-ASKEW_RAD, ASKEW_RAD, 2 * count)
    conditions = (
        Conditions(terrain, friction=0.6, latency_substeps=POLICY_DECIMATION, map_errors=True)
        if hard
        else Conditions.mixed(2 * count, rng, terrain)
    )
    trial = Trial(policy, conditions, starts, heading, rng)
    outcome, config = OutcomeConfig(), replace(PathConfig(), cruise_m_s=CRUISE_M_S)
    controllers = [PathController(task, config) for task in tasks_along(policy, paths)]
    drivers = Drivers(controllers, trial)
    limit_s = outcome.timeout_factor * np.array([c.nominal_s for c in controllers])
    while trial.going.any():
        drivers.step()
        trial.leave(np.isinf(drivers.done_s) & (trial.time_s > limit_s))
    near = np.linalg.norm(trial.position_m[:, :2] - goals, axis=1) <= outcome.success_m
    arrived = near & np.isfinite(drivers.done_s) & ~trial.fallen
    way = (trial.position_m[:, 0] - starts[:, 0]) / (goals - starts)[:, 0]
    result: dict[str, float] = {"flights": count}
    for name, those in (("up", up), ("down", ~up)):
        result |= {
            f"{name}_arrived": float(arrived[those].mean()),
            f"{name}_falls": int(trial.fallen[those].sum()),
            f"{name}_walked": float(np.clip(way[those], 0.0, 1.0).mean()),
        }
    return result
