"""Closed loop: observations and episodes per time, two workers against one, memory of resets."""

import gc
import math
import os
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from vlnpe.evaluation.env import NavigationEnv
from vlnpe.evaluation.observation import Observation
from vlnpe.evaluation.policies.baselines import Random
from vlnpe.evaluation.policies.learned import LearnedPolicy
from vlnpe.evaluation.policy import Assignment, Policy
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.rollout import Action
from vlnpe.formats.vlnce.files import read_episodes
from vlnpe.learning.card import Card, View
from vlnpe.learning.checkpoint import Checkpoint
from vlnpe.learning.config import ModelConfig, TrainConfig
from vlnpe.learning.models.cma import Cma
from vlnpe.learning.models.registry import build_model
from vlnpe.learning.stepper import Choice
from vlnpe.rendering.camera.views import make_view

ROBOTS = ("aliengo", "h1", "g1", "jetbot")
STEPS = 30  # actions of each of the first episodes
EPISODES = 3
WALKS = 8  # episodes whose evaluation is timed
RESETS = 1000
WARM_UP = 100  # resets before memory is looked at
SECONDS = 20.0  # how long each worker steps in the comparison of one with two
IMAGE_PX = 256
# CMA at the sizes of VLN-CE's: hidden states of 512, images of 224.
CMA = ModelConfig(hidden=512, words=50)
NEVER = -1e9  # bias of an action that is never drawn


def report(run: Path) -> str:
    """Step through episodes of `run`, evaluate, and reset many times; a Markdown section."""
    scene = sorted((run / "scenes").iterdir())[0]
    recorded = read_episodes(sorted((run / "episodes").glob("*.json.gz"))[0])
    episodes = [e for e in recorded if e.scene_id == scene.name and e.level == recorded[0].level]
    rows = []
    for robot in ROBOTS:
        cost_ms = []
        for images in (True, False):
            env = NavigationEnv(scene, episodes, robot=robot, images=images)
            cost_ms.append(_milliseconds(env))
            env.close()
        seeing, blind = cost_ms
        rows.append(f"| {robot} | {seeing:.1f} | {blind:.1f} | {1000 / seeing:.0f} |")
    env = NavigationEnv(scene, episodes, robot="h1")
    hourly = [
        f"| {name} | {_cost(env, policy)} |"
        for name, policy in (("random", Random()), ("CMA, VLN-CE's sizes", _cma(episodes)))
    ]
    env.close()
    env = NavigationEnv(
        scene, episodes, robot="jetbot", view=make_view("ego", "jetbot", width_px=IMAGE_PX)
    )
    growth_mib = _growth_mib(env)
    env.close()
    load = os.getloadavg()[0]
    alone, both = _rates(run, 1)[0], sum(_rates(run, 2))
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
            f"Evaluation of H1 under `speed`, {WALKS} episodes to their end, at most 500",
            "actions; VLN-PE states 62 to 78 episodes per GPU-hour on Isaac Sim. The CMA is",
            "untrained: its weights are random, it draws its actions, and the biases of its action",
            "head are R2R's proportions without STOP, so that it walks until the robot falls or is",
            "stuck. `random` stops, which makes its episodes shorter:",
            "",
            "| policy | actions per episode | CPU ms per action | episodes per CPU-hour |",
            "| --- | --- | --- | --- |",
            *hourly,
            "",
            f"Two processes make {both / alone:.2f} times the observations per second of one "
            f"({both:.0f} against {alone:.0f} in {SECONDS:g} s of wall time; load before: "
            f"{load:.1f} on {os.cpu_count()} cores).",
            "",
            f"{RESETS} resets with images and one action each: from reset {WARM_UP} on, memory "
            f"grew by {growth_mib:.1f} MiB.",
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


def _cost(env: NavigationEnv, policy: Policy) -> str:
    """Evaluate with images on one core: actions, CPU time of each, episodes per hour of it."""
    torch.set_num_threads(1)
    steps, start = 0, time.process_time()
    for number in range(WALKS):
        chosen = number % len(env.episodes)
        shown, _ = env.reset(options={"episode": chosen})
        # Draws depend on the episode's id.
        walk = replace(env.episodes[chosen], episode_id=f"walk-{number}")
        policy.reset(Assignment.of(walk, "h1", "speed"))
        over, step = False, 0
        while not over:
            action = policy.act(Observation(**shown, step=step))
            shown, _, terminated, truncated, _ = env.step(action)
            over, step = terminated or truncated, step + 1
        steps += step
    seconds = time.process_time() - start
    return f"{steps / WALKS:.0f} | {1000 * seconds / steps:.1f} | {3600 * WALKS / seconds:.0f}"


def _cma(episodes: Sequence[Episode]) -> LearnedPolicy:
    """Return an untrained CMA that walks: what it costs does not depend on its weights."""
    words = sorted({word for e in episodes for word in e.instruction.lower().split()})
    card = Card(
        TrainConfig(model=CMA, size_px=224), ("<pad>", "<unk>", *words), View(256, 256, 90.0, 10.0)
    )
    torch.manual_seed(0)
    model = build_model(card.tokens, CMA).eval()
    assert isinstance(model, Cma)
    with torch.no_grad():
        model.heads.act.weight.zero_()
        model.heads.act.bias.fill_(NEVER)
        for action, share in zip(Random.actions, Random.proportions, strict=True):
            if action is not Action.STOP:
                model.heads.act.bias[action] = math.log(share)
    return LearnedPolicy(Checkpoint(card, model, ""), Choice(sample=True))


def _growth_mib(env: NavigationEnv) -> float:
    """Growth of the peak resident size over many resets with images."""
    before = 0
    for k in range(RESETS):
        if k == WARM_UP:
            gc.collect()
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        env.reset(seed=k)
        env.step(1)
    return (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024


_WORKER = """
import sys, time
from pathlib import Path
import numpy as np
from vlnpe.evaluation.env import NavigationEnv
from vlnpe.formats.vlnce.files import read_episodes
run, seconds = Path(sys.argv[1]), float(sys.argv[2])
scene = sorted((run / "scenes").iterdir())[0]
recorded = read_episodes(sorted((run / "episodes").glob("*.json.gz"))[0])
episodes = [e for e in recorded if e.scene_id == scene.name and e.level == recorded[0].level]
env = NavigationEnv(scene, episodes, robot="aliengo")
rng = np.random.default_rng(0)
env.reset(seed=0)
env.step(1)
print("ready", flush=True)
sys.stdin.readline()
start, count, over = time.perf_counter(), 0, True
while time.perf_counter() - start < seconds:
    if over:
        env.reset(seed=count)
        over = False
    else:
        _, _, terminated, truncated, _ = env.step(int(rng.choice([1, 1, 1, 2, 3])))
        over = terminated or truncated
    count += 1
print(count / (time.perf_counter() - start), flush=True)
env.close()
"""


def _rates(run: Path, workers: int) -> list[float]:
    """Observations per second of wall time of processes that step at the same time."""
    started = [
        subprocess.Popen(
            [sys.executable, "-c", _WORKER, str(run), str(SECONDS)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"},
        )
        for _ in range(workers)
    ]
    pipes = [(p.stdin, p.stdout) for p in started if p.stdin and p.stdout]
    for _, out in pipes:
        out.readline()
    for into, _ in pipes:
        into.write("\n")
        into.flush()
    rates = [float(out.readline()) for _, out in pipes]
    for process in started:
        process.wait()
    return rates
