"""Physics with the policy on one core: a furnished scene against an empty plane."""

from __future__ import annotations

import time
from pathlib import Path

import mujoco
import numpy as np

from vlnpe.collectors.locomotion.policy import GaitPolicy
from vlnpe.collectors.replay import ReplayConfig, replay_in
from vlnpe.collectors.robots import POLICY_DECIMATION, TIMESTEP_S, get_robot
from vlnpe.collectors.world import open_world
from vlnpe.formats.scene_bundle import load_bundle
from vlnpe.formats.vlnce import read_episodes

ROBOT = "aliengo"
EMPTY_SECONDS = 20.0


def report(run: Path) -> str:
    """Replay the episodes in `run` and return a Markdown section."""
    empty = empty_world_ratio()
    rows = []
    episodes = read_episodes(run / "episodes" / "train.json.gz")
    bundle = load_bundle(run / "scenes" / episodes[0].scene_id)
    config = ReplayConfig(robot=ROBOT)
    for controller in ("path", "speed"):
        config = ReplayConfig(robot=ROBOT, controller=controller)
        world = open_world(bundle, 0, get_robot(ROBOT), None, config.physics)
        replay_in(world, episodes[0], config)  # warm up
        walked, started = 0.0, time.perf_counter()
        for episode in episodes:
            walked += replay_in(world, episode, config).metrics.duration_s
        ratio = walked / (time.perf_counter() - started)
        rows.append(
            f"| {bundle.scene_id}, {controller}, {world.model.ngeom} geoms | {ratio:.0f} × "
            f"| {ratio / empty:.2f} |"
        )
    return "\n".join(
        [
            "## Physics and policy, one core",
            "",
            f"{ROBOT}; the replay rows include controller, contacts, recording and metrics.",
            "",
            "| world | real time | of the empty world |",
            "| --- | ---: | ---: |",
            f"| empty plane, physics and policy only | {empty:.0f} × | 1 |",
            *rows,
            "",
        ]
    )


def empty_world_ratio() -> float:
    """Simulated seconds per second of a robot walking on a plane."""
    robot = get_robot(ROBOT)
    model = robot.build_model()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0) if model.nkey else None
    policy = GaitPolicy.load(robot)
    policy.reset()
    steps = round(EMPTY_SECONDS / (TIMESTEP_S * POLICY_DECIMATION))
    command = np.array([0.6, 0.0, 0.2])
    started = time.perf_counter()
    for _ in range(steps):
        data.ctrl[:] = policy.act(data, command)
        mujoco.mj_step(model, data, POLICY_DECIMATION)
    return EMPTY_SECONDS / (time.perf_counter() - started)
