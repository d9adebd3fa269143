"""Physics with the gait on one core: every robot in an empty world and in furnished scenes."""

import time
from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np

from vlnpe.collectors.locomotion.runtime.drives import gait_for
from vlnpe.collectors.replay.replay import ReplayConfig, replay_in
from vlnpe.collectors.replay.world import open_world
from vlnpe.collectors.robots import POLICY_DECIMATION, ROBOTS, TIMESTEP_S, RobotHandles, RobotSpec
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.trajectory_sampler.config import SampleConfig
from vlnpe.trajectory_sampler.sampling import sample_episodes

EPISODES = 8
EMPTY_S = 30.0
COMMAND = (0.6, 0.0, 0.2)
PERIOD_S = TIMESTEP_S * POLICY_DECIMATION


@dataclass(frozen=True)
class Timing:
    """A simulation and its time.

    Attributes:
        simulated_s: of the robot's time.
        cpu_s: of this core's.
        gait_s: share of the gait (policy or wheel drive), measured where it was.
        geoms: of the model.
    """

    simulated_s: float
    cpu_s: float
    geoms: int
    gait_s: float = 0.0

    @property
    def steps_per_s(self) -> float:
        return self.simulated_s / TIMESTEP_S / self.cpu_s

    @property
    def real_time(self) -> float:
        return self.simulated_s / self.cpu_s


def report(scenes: Iterable[SceneBundle]) -> str:
    """Drive every robot everywhere and return a Markdown section."""
    robots = [robot for robot in ROBOTS.values() if robot.joints]
    widest_m = max(robot.footprint_radius_m for robot in robots)
    places = [(bundle, _episodes(bundle, widest_m)) for bundle in scenes]
    rows = []
    for robot in robots:
        empty = empty_world(robot)
        act_us = 1e6 * empty.gait_s / (empty.simulated_s / PERIOD_S)
        rows.append(_row(robot.name, "empty plane", empty, empty, f"{act_us:.0f}"))
        for bundle, episodes in places:
            walked = replayed(robot, bundle, episodes)
            rows.append(_row(robot.name, bundle.scene_id, walked, empty, ""))
    return "\n".join(
        [
            "## Physics and gait, one core",
            "",
            f"{1 / TIMESTEP_S:.0f} physics steps and {1 / PERIOD_S:.0f} gait steps a second, CPU "
            "time. The empty plane is physics and gait alone;",
            f"the scenes are {EPISODES} episodes replayed by the path controller, with contacts, "
            "recording and metrics.",
            "",
            "| robot | world | geoms | physics steps/s | × real time | of the empty plane "
            "| µs per gait step |",
            "| --- | --- | ---: | ---: | ---: | ---: | ---: |",
            *rows,
            "",
        ]
    )


def _row(robot: str, world: str, timing: Timing, empty: Timing, act_us: str) -> str:
    return (
        f"| {robot} | {world} | {timing.geoms} | {timing.steps_per_s:,.0f} "
        f"| {timing.real_time:.0f} | {timing.real_time / empty.real_time:.2f} | {act_us} |"
    )


def _episodes(bundle: SceneBundle, radius_m: float) -> list[Episode]:
    config = SampleConfig(count=EPISODES, robot_radius_m=max(radius_m, SampleConfig.robot_radius_m))
    return sample_episodes(bundle, config, np.random.default_rng(0)).episodes


def empty_world(robot: RobotSpec) -> Timing:
    """Return a robot that walks a circle on a plane."""
    model = robot.build_model()
    data, gait = mujoco.MjData(model), gait_for(robot)
    handles, spent = RobotHandles.find(robot, model), 0.0
    for seconds in (1.0, EMPTY_S):  # the first round compiles and fills caches
        gait.reset()
        mujoco.mj_resetData(model, data)
        handles.spawn(data)
        spent, started = 0.0, time.process_time()
        for _ in range(round(seconds / PERIOD_S)):
            before = time.process_time_ns()
            data.ctrl[handles.actuators] = gait.act(data, COMMAND)
            spent += 1e-9 * (time.process_time_ns() - before)
            mujoco.mj_step(model, data, nstep=POLICY_DECIMATION)
        cpu_s = time.process_time() - started
    return Timing(EMPTY_S, cpu_s, model.ngeom, spent)


def replayed(robot: RobotSpec, bundle: SceneBundle, episodes: list[Episode]) -> Timing:
    """Return a robot that walks episodes of one scene."""
    config = ReplayConfig(robot=robot.name, controller="path")
    worlds = {
        level: open_world(bundle, level, robot, None, config.physics)
        for level in sorted({episode.level for episode in episodes})
    }
    replay_in(worlds[episodes[0].level], episodes[0], config)  # compiles and fills caches
    started, simulated_s = time.process_time(), 0.0
    for episode in episodes:
        rollout = replay_in(worlds[episode.level], episode, config)
        simulated_s += rollout.metrics.duration_s
    cpu_s = time.process_time() - started
    return Timing(simulated_s, cpu_s, worlds[episodes[0].level].model.ngeom)
