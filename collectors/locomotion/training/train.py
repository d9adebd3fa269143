"""Train a gait; run the same command again to resume after an interruption.

`python -m vlnpe.collectors.locomotion.training.train aliengo [--publish]`

`--terrain stairs` trains what a gait lacks to climb stairs, on top of its footing (`footing.py`).

Writes `checkpoint.pt`, `curve.csv` and, at each checkpoint, the policy and its card into the
output folder; `--publish` evaluates the result and installs it, a robot of one's own in its folder.
"""

import csv
import logging
import time
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
import tyro
from rsl_rl.runners import OnPolicyRunner

from ....formats.core.atomic import atomic_file
from ....formats.core.errors import InputError, VlnpeError
from ...robots import RobotSpec, get_robot
from ..trials.terrain import Terrain, rough_terrain, stairs_terrain
from .config import Phases, TrainingConfig, ppo_config, stairs_phases
from .env import GaitEnv
from .export import write_policy
from .recipes import recipe
from .stairs.base import Base
from .stairs.reach import footing
from .workers import Workers

log = logging.getLogger(__name__)
RISERS_M, GOINGS_M, LANES, STEPS = (0.03, 0.19), (0.25, 0.31), 12, 7  # of stairs
CHUNK = 10  # iterations per line of the learning curve


@dataclass(frozen=True)
class Arguments:
    """Train one robot's gait.

    Attributes:
        robot: registry name, or the folder of a robot of one's own that has a table [gait] in
            robot.toml.
        out: folder of checkpoints and learning curve; default `runs/gait-<robot>`, on stairs
            `runs/stairs-<robot>`.
        terrain: level, for a gait from scratch; or stairs, for what is added to a finished gait so
            that it climbs.
        start: folder of that gait; default the installed one.
        seed: random seed of the training.
        threads: number of threads for physics, of each worker.
        workers: number of processes that share the robots; more than one pays from 4 cores on.
        device: where PyTorch learns: cpu, cuda.
        publish: evaluate the result and install it into the package.
        iterations: PPO iterations per phase; default as configured. For a quick trial.
    """

    robot: tyro.conf.Positional[str]
    out: Path | None = None
    terrain: Literal["level", "stairs"] = "level"
    start: Path | None = None
    seed: int = 0
    threads: int = 2
    workers: int = 1
    device: str = "cpu"
    publish: bool = False
    iterations: int | None = None


def run(arguments: Arguments) -> None:
    """Train as the command line says.

    Raises:
        UnknownNameError: there is no such robot.
        InputError: it does not walk, or does not say how it steps.
    """
    robot = get_robot(arguments.robot)
    stairs = arguments.terrain == "stairs"
    out = arguments.out or Path("runs") / f"{'stairs' if stairs else 'gait'}-{robot.name}"
    train(robot, out, arguments)
    if arguments.publish:
        # Late, because it needs more than training does.
        from ..trials.evaluate import publish, publish_stairs

        (publish_stairs if stairs else publish)(robot, out)


def train(robot: RobotSpec, out: Path, arguments: Arguments) -> None:
    """Run all phases of the robot's training, going on from the last checkpoint in `out`."""
    seed, iterations = arguments.seed, arguments.iterations
    # The networks are small: more torch threads cost more than they give.
    torch.set_num_threads(1)
    checkpoint = out / "checkpoint.pt"
    done, samples, wall_s = 0, 0, 0.0
    first = 0
    stairs = arguments.terrain == "stairs"
    if arguments.start and not stairs:
        raise InputError(f"--start {arguments.start}: a gait on level ground starts from nothing")
    level = recipe(robot).phases
    phases = stairs_phases(level, robot.leans) if stairs else level
    base = Base.load(robot, arguments.start) if stairs else None
    added_to = base.card.network_sha256 if base else ""
    if base is not None:
        footing(robot, base.card.gait)  # raises if the legs cannot follow stairs
    for phase, _ in phases:
        if arguments.workers < 1 or phase.envs % arguments.workers:
            raise InputError(
                f"--workers {arguments.workers}; valid: a divisor of {phase.envs}, the robots"
            )
    out.mkdir(parents=True, exist_ok=True)
    for number, (phase, planned) in enumerate(phases):
        last = first + (planned if iterations is None else iterations)
        if checkpoint.exists():
            progress = torch.load(checkpoint, map_location="cpu", weights_only=True)["infos"]
            done, samples, wall_s = (progress[k] for k in ("iterations", "samples", "wall_s"))
            if progress.get("base", "") != added_to:
                raise InputError(
                    f"{checkpoint}: was trained on top of another gait; use a new --out"
                )
        if done >= last:
            first = last
            continue
        log.info("phase %d: %s terrain, iterations %d to %d", number, phase.terrain, done, last)
        rng = np.random.default_rng([seed, number, done])
        torch.manual_seed(seed + done)
        env = _environment(robot, phase, rng, base, arguments)
        settings = {**ppo_config(phase, seed), "multi_gpu": None}
        runner = OnPolicyRunner(env, settings, device=arguments.device)
        if checkpoint.exists():
            runner.load(str(checkpoint), map_location=arguments.device)
        elif base is not None:
            # At first nothing is added to the gait that is there.
            for parameter in runner.alg.get_policy().mlp[-1].parameters():
                torch.nn.init.zeros_(parameter)
        try:
            while done < last:
                started = time.monotonic()
                # Robots first learn to walk, then to walk smoothly and to be kicked.
                env.push_scale = min(1.0, max(0.0, (done - 100) / 300))
                env.smoothness_scale = 1.0 if base else min(1.0, 0.2 + done / 300)
                count = min(CHUNK, last - done)
                runner.learn(count)
                done += count
                samples += count * phase.envs * phase.steps
                wall_s += time.monotonic() - started
                _write_curve(out / "curve.csv", env, runner, done, samples, wall_s)
                progress = {"iterations": done, "samples": samples, "wall_s": wall_s}
                progress |= {"base": added_to} if base else {}
                with atomic_file(checkpoint) as temporary:
                    runner.save(str(temporary), progress)
                if done % 50 == 0 or done == last:
                    facts = _facts(phases, seed, progress)
                    write_policy(
                        robot, phase, runner.alg.get_policy(), facts, out, base, env.footing
                    )
        finally:
            if isinstance(env, Workers):
                env.close()
        first = last


def _environment(
    robot: RobotSpec,
    phase: TrainingConfig,
    rng: np.random.Generator,
    base: Base | None,
    arguments: Arguments,
) -> GaitEnv | Workers:
    """Return the robots of a phase, in this process or shared by several."""
    count = arguments.workers
    share = replace(phase, envs=phase.envs // count)
    generators = rng.spawn(count) if count > 1 else [rng]

    def build(number: int) -> GaitEnv:
        own = generators[number]
        return GaitEnv(robot, share, ground(phase.terrain, own), own, arguments.threads, base)

    first = build(0)
    if count == 1:
        return first
    first.get_observations()
    first.step(torch.zeros(share.envs, first.num_actions))  # compiles
    return Workers(first, build, count)


def ground(kind: str, rng: np.random.Generator) -> Terrain:
    """Return the ground that a phase of training names: flat, rough or stairs."""
    if kind == "stairs":
        risers = np.linspace(*RISERS_M, LANES)
        return stairs_terrain(risers.tolist(), rng.uniform(*GOINGS_M, LANES).tolist(), STEPS)
    return rough_terrain(rng) if kind == "rough" else Terrain()


def _facts(phases: Phases, seed: int, progress: dict[str, Any]) -> dict[str, Any]:
    return {
        "algorithm": "PPO (rsl-rl-lib) over mujoco.batch",
        "seed": seed,
        **progress,
        "phases": [{**asdict(p), "iterations": count} for p, count in phases],
        "versions": {name: version(name) for name in ("mujoco", "rsl-rl-lib", "torch")},
    }


def _write_curve(
    path: Path,
    env: GaitEnv | Workers,
    runner: OnPolicyRunner,
    done: int,
    samples: int,
    wall_s: float,
) -> None:
    means, walks = env.take_statistics()
    row: dict[str, float] = {
        "iteration": done,
        "samples": samples,
        "wall_s": round(wall_s, 1),
        "learning_rate": runner.alg.learning_rate,
        "action_std": float(runner.alg.get_policy().output_std.detach().mean()),
        **{name: round(value, 5) for name, value in means.items()},
    }
    log.info(
        "%5d  %5.1f M  %6.0f s  reward %6.3f  error %.3f m/s %.3f rad/s  falls/min %.2f",
        done,
        samples / 1e6,
        wall_s,
        row["reward"],
        row["linear_error"],
        row["yaw_error"],
        row["falls_per_minute"],
    )
    shares = []
    for riser_m, (climbed, count) in zip(np.linspace(*RISERS_M, len(walks)), walks, strict=True):
        name = f"{100 * riser_m:.1f}cm"
        row |= {f"climbed_{name}": round(climbed / max(count, 1), 3), f"episodes_{name}": count}
        shares.append(f"{name} {climbed / max(count, 1):.0%}")
    if shares:
        log.info("       climbed  %s", "  ".join(shares))
    fresh = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(row))
        if fresh:
            writer.writeheader()
        writer.writerow(row)


def main() -> None:
    """Run the command line of `make train-gait`."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    try:
        run(tyro.cli(Arguments))
    except VlnpeError as error:
        raise SystemExit(f"train-gait: {error}") from None


if __name__ == "__main__":
    main()
