"""Closed loop: observations per second of the environment, and the memory of many resets."""

from __future__ import annotations

import resource
import time
from pathlib import Path

import numpy as np

from vlnpe.evaluation.env import NavigationEnv
from vlnpe.formats.vlnce.files import read_episodes

ROBOTS = ("aliengo", "h1", "g1", "jetbot")
STEPS = 30  # actions of each of the first episodes
EPISODES = 3
RESETS = 1000
WARM_UP = 50  # resets before memory is looked at


def report(run: Path) -> str:
    """Step through episodes of `run` and reset many times; a Markdown section."""
    scene = sorted((run / "scenes").iterdir())[0]
    found = read_episodes(sorted((run / "episodes").glob("*.json.gz"))[0])
    episodes = [e for e in found if e.scene_id == scene.name and e.level == found[0].level]
    rows = []
    for robot in ROBOTS:
        cost_ms = []
        for images in (True, False):
            env = NavigationEnv(scene, episodes, robot=robot, images=images)
            cost_ms.append(_milliseconds(env))
            env.close()
        seeing, blind = cost_ms
        rows.append(f"| {robot} | {seeing:.1f} | {blind:.1f} | {1000 / seeing:.0f} |")
    env = NavigationEnv(scene, episodes, robot="jetbot", images=False)
    growth_mib = _growth_mib(env)
    env.close()
    return "\n".join(
        [
            "## Closed loop",
            "",
            "One environment on one core, 256 x 256 RGB-D, VLN-PE's timing (0.25 s an action).",
            "",
            "| robot | CPU ms per observation | without images | observations per CPU-second |",
            "| --- | --- | --- | --- |",
            *rows,
            "",
            f"{RESETS} resets with one action each: memory grew by {growth_mib:.1f} MiB.",
        ]
    )


def _milliseconds(env: NavigationEnv) -> float:
    """Return CPU time per observation, of resets and steps together."""
    rng = np.random.default_rng(0)
    env.reset(options={"episode": 0})
    env.step(1)
    start, count = time.process_time(), 0
    for number in range(min(EPISODES, len(env.episodes))):
        env.reset(options={"episode": number})
        count += 1
        for _ in range(STEPS):
            _, _, terminated, truncated, _ = env.step(int(rng.choice([1, 1, 1, 2, 3])))
            count += 1
            if terminated or truncated:
                break
    return 1000 * (time.process_time() - start) / count


def _growth_mib(env: NavigationEnv) -> float:
    """Growth of the peak resident size over many resets."""
    before = 0
    for k in range(RESETS):
        if k == WARM_UP:
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        env.reset(seed=k)
        env.step(1)
    return (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
