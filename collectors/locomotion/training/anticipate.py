"""Teach a gait to act ahead of a delay; run the same command again to go on.

`python -m vlnpe.collectors.locomotion.training.anticipate h1 --out runs/late-h1`

A gait copes with actions that arrive up to 20 ms late. Where they arrive 60 ms late, the one sent
now should be what the gait will want 40 ms from now: then it seems to act 20 ms late. What it will
want is known 40 ms later, so a second network beside the gait's can learn it from examples instead
of from rewards: from walks of robots that it drives itself (DAgger, Ross et al. 2011). No delay is
given to it, but it sees what the motors were told and did in the last 0.1 s. Where actions are in
time there is nothing to add, and the gait stays what it was.
"""

import logging
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import tyro
from numpy.typing import NDArray

from ....formats.core.arrays import Array, Mask
from ....formats.core.atomic import atomic_file
from ...robots import POLICY_DECIMATION, RobotSpec, get_robot
from ..runtime.card import PolicyCard
from ..runtime.network import encode_layers
from ..runtime.observation import layout
from ..runtime.policy import GaitPolicy, policy_files
from ..trials.aim import command_bounds
from ..trials.terrain import Terrain, noise_terrain
from ..trials.trial import Conditions, Trial
from .correction import PAST, Corrected, Correction, Samples, beside
from .export import install, plain_card
from .randomize import ACTION_S, sample_actions, sample_commands
from .stairs.base import layers_of

log = logging.getLogger(__name__)
ROBOTS, SECONDS = 160, 8.0  # of one round of walks
LATE_SUBSTEPS = 14  # 70 ms
RECENT_ROUNDS = 14  # older walks were led by a network that knew less
FIRST_PASSES, PASSES, BATCH, RATE = 1.5, 4.0, 1024, 1e-3
# Errors beyond this, of robots about to fall, count linearly.
SMOOTH_L1 = 0.5


def walks(
    gait: GaitPolicy, correction: Correction, rng: np.random.Generator
) -> tuple[Samples, Samples]:
    """Drive robots with delays of up to 70 ms; return observations (K, D) and what lacked (K, P).

    On level ground or bumps, with kicks or without, under commands like those of the training.
    """
    robot, count = gait.robot, ROBOTS
    late = rng.integers(0, LATE_SUBSTEPS + 1, count)
    rough = rng.random() < 0.4
    conditions = Conditions(
        terrain=noise_terrain(rng, float(rng.choice([0.04, 0.06]))) if rough else Terrain(),
        friction=rng.uniform(0.4, 1.2, count),
        latency_substeps=late,
        push_m_s=float(rng.choice([0.0, 0.5, 0.8])),
    )
    network = Corrected(gait.network, correction)
    driver = GaitPolicy(robot, _card(gait.card, robot), network)
    place, heading = rng.uniform(-4, 4, (count, 2)), rng.uniform(-np.pi, np.pi, count)
    trial = Trial(driver, conditions, place, heading, rng)
    up = [~trial.fallen for _ in network.seen]
    bounds = command_bounds(robot.command_limits)
    command, until = np.zeros((count, 3)), np.zeros(count)
    while trial.time_s < SECONDS:
        due = trial.time_s >= until
        hurried = rng.random(count) < 0.15
        fresh = sample_commands(rng, count, bounds)
        fresh[hurried] = sample_actions(rng, int(hurried.sum()))
        wait = np.where(hurried, ACTION_S * rng.integers(1, 4, count), rng.uniform(1, 4, count))
        command[due], until[due] = fresh[due], trial.time_s + wait[due]
        up.append(~trial.fallen)
        trial.step(command)
    log.info(
        "  %.0f %% fell, rough %s, kicks %.1f m/s",
        100 * trial.fallen.mean(),
        rough,
        conditions.push_m_s,
    )
    done = np.clip(network.done, -gait.card.action_clip, gait.card.action_clip)
    return _lessons(gait, np.array(network.seen), done, np.array(up[: len(done)]), late)


def _lessons(
    gait: GaitPolicy, seen: Samples, done: Samples, up: Mask, late: NDArray[np.intp]
) -> tuple[Samples, Samples]:
    """Return observations (K, D) of T steps of N robots, and what lacked in the actions (K, P).

    Args:
        gait: the gait that the delays are to be hidden from.
        seen: (T, N, D).
        done: (T, N, P) actions.
        up: (T, N) whether the robot still took part.
        late: (N,) delays in physics steps.
    """
    width, scale, joints = gait.network.inputs, gait.robot.action_scale_rad, done.shape[2]
    reference = np.array([_reference(gait, step) for step in seen]) / scale
    # Steps by which to look ahead: a delay of one step is left to the gait.
    ahead = np.maximum(-(-late // POLICY_DECIMATION) - 1, 0)
    given, lacking = [], []
    for steps in np.unique(ahead):
        robots = np.flatnonzero(ahead == steps)
        for t in range(1, len(seen) - steps):
            who = robots[up[t + steps, robots]]
            then = seen[t + steps, who, :width].astype(np.float64)
            # What the gait will take for its last action: the one that was sent a step before,
            # as an offset from the reference of the step in which it will seem to be sent.
            shift = reference[t + steps - 1, who] - reference[t - 1, who]
            then[:, -joints:] = done[t - 1, who] - shift
            target = gait.infer(then) + reference[t + steps, who] - reference[t, who]
            given.append(seen[t, who])
            now = seen[t, who, :width].astype(np.float64)
            lacking.append(target - gait.infer(now))
    return np.concatenate(given), np.concatenate(lacking).astype(np.float32)


def _reference(gait: GaitPolicy, seen: Samples) -> Array:
    """Return the clock's joint offsets (N, P) [rad] for observations (N, D)."""
    sine, cosine = seen[:, 12].astype(np.float64), seen[:, 13].astype(np.float64)
    phase, moving = np.arctan2(sine, cosine) / (2.0 * np.pi) % 1.0, np.hypot(sine, cosine) > 0.5
    offsets = gait.card.gait.reference(phase, moving, seen[:, 9:12].astype(np.float64))
    return offsets[:, : gait.robot.policy_joints]


def learn(
    correction: Correction,
    lessons: Sequence[tuple[Samples, Samples]],
    passes: float,
    rng: np.random.Generator,
) -> float:
    """Fit the correction to lessons in so many passes; returns the mean loss of the last steps."""
    seen, lacking = (np.concatenate(part) for part in zip(*lessons, strict=True))
    steps = max(2, int(passes * len(seen) / BATCH))
    optimizer = torch.optim.Adam(correction.mlp.parameters(), lr=RATE)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, steps, pct_start=0.1)
    losses = []
    for _ in range(steps):
        at = rng.integers(0, len(seen), BATCH)
        loss = torch.nn.functional.smooth_l1_loss(
            correction(torch.from_numpy(seen[at])), torch.from_numpy(lacking[at]), beta=SMOOTH_L1
        )
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(correction.mlp.parameters(), 1.0)
        optimizer.step()
        schedule.step()
        losses.append(float(loss.detach()))
    return float(np.mean(losses[-50:]))


def _card(card: PolicyCard, robot: RobotSpec) -> PolicyCard:
    return replace(card, observation=layout(robot.policy_joints, PAST), evaluation={})


def anticipate(robot: RobotSpec, start: Path, out: Path, rounds: int, seed: int = 0) -> None:
    """Walk and learn for so many rounds in all, going on from those in `out`."""
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    plain_card(robot, start)
    gait = GaitPolicy.load(robot, start)
    out.mkdir(parents=True, exist_ok=True)
    correction, checkpoint = Correction(robot), out / "checkpoint.pt"
    done, samples, cpu_s = 0, 0, 0.0
    if checkpoint.exists():
        state = torch.load(checkpoint, weights_only=True)
        correction.load_state_dict(state["correction"])
        done, samples, cpu_s = state["rounds"], state["samples"], state["cpu_s"]
    for number in range(done, rounds):
        began = time.process_time()
        rng = np.random.default_rng([seed, number])
        lesson = walks(gait, correction, rng)
        with atomic_file(out / f"lessons-{number:03d}.npz") as temporary, temporary.open("wb") as f:
            np.savez(f, seen=lesson[0], lacking=lesson[1])
        samples += len(lesson[0])
        if number == 0:
            correction.mean[:] = torch.from_numpy(lesson[0].mean(axis=0))
            correction.std[:] = torch.from_numpy(lesson[0].std(axis=0) + 1e-3)
        recent = range(max(0, number + 1 - RECENT_ROUNDS), number + 1)
        lessons = [_read(out / f"lessons-{k:03d}.npz") for k in recent]
        loss = learn(correction, lessons, PASSES if number else FIRST_PASSES, rng)
        cpu_s += time.process_time() - began
        log.info("round %d: %d samples, loss %.4f, %.0f CPU-s", number, samples, loss, cpu_s)
        state = {"rounds": number + 1, "samples": samples, "cpu_s": cpu_s}
        with atomic_file(checkpoint) as temporary:
            torch.save({**state, "correction": correction.state_dict()}, temporary)
        facts = {
            **state,
            "seed": seed,
            "of": gait.card.network_sha256,
            "late_substeps": LATE_SUBSTEPS,
        }
        training = {**gait.card.training, "anticipation": facts}
        # The calibration stays.
        content = encode_layers(*beside(layers_of(robot, start), correction.layers()))
        card = replace(_card(gait.card, robot), training=training)
        install(content, card, policy_files(robot, out))


def _read(path: Path) -> tuple[Samples, Samples]:
    with np.load(path, allow_pickle=False) as arrays:
        return arrays["seen"], arrays["lacking"]


def main(
    robot: Annotated[str, tyro.conf.Positional],
    out: Path | None = None,
    start: Path | None = None,
    rounds: int = 6,
    seed: int = 0,
) -> None:
    """Teach a robot's gait to act ahead of a delay.

    Args:
        robot: registry name, or the folder of a robot of one's own.
        out: folder of checkpoint and gait; default `runs/late-<robot>`.
        start: folder of the gait to begin with; default that of its training, `runs/gait-<robot>`.
        rounds: of walking and learning.
        seed: random seed.
    """
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    spec = get_robot(robot)
    start = start or Path("runs") / f"gait-{spec.name}"
    anticipate(spec, start, out or Path("runs") / f"late-{spec.name}", rounds, seed)


if __name__ == "__main__":
    tyro.cli(main)
