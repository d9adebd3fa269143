"""Evaluation of a gait: the table that goes into its card, and the gates it must pass.

`python -m vlnpe.collectors.locomotion.trials.evaluate aliengo` measures the installed policy;
`--policy runs/gait-aliengo` the one in a training's folder, `--publish` installs that one with its
table.
"""

import json
import logging
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from ....formats.core.atomic import write_bytes
from ....formats.core.errors import InputError, VlnpeError
from ...controllers import SpeedConfig
from ...robots import RobotSpec, get_robot
from ..runtime.card import PolicyCard, load_card, save_card
from ..runtime.policy import GaitPolicy, policy_files, stairs_files
from ..state import State
from ..training.stairs.reach import footing
from .aim import calibrated
from .driven import action_errors, follow_paths
from .flights import flights
from .gates import CLOSED_LOOP, TIMED, gate_results
from .measures import (
    command_grid,
    plate_stops,
    posture,
    pushes,
    standing,
    standing_pushes,
    stops,
    velocity_errors,
)
from .terrain import noise_terrain, plate_terrain, ramp_terrain
from .trial import POLICY_DECIMATION, Conditions

log = logging.getLogger(__name__)

LATE_SUBSTEPS = 12  # 60 ms
SEED = 1234  # of the trials; their terrain and seeds differ from those of training


def evaluation_table(policy: GaitPolicy, seed: int = SEED, scale: float = 1.0) -> dict[str, Any]:
    """Return the whole table; `scale` < 1 takes fewer robots, and below 0.1 fewer commands."""
    rng = np.random.default_rng(seed)
    many, few = max(2, round(200 * scale)), max(2, round(24 * scale))
    rough = {f"noise_{cm}cm": noise_terrain(rng, 0.01 * cm) for cm in (4, 6)}
    grid = command_grid(policy.robot, points=3 if scale >= 0.1 else 2)
    table: dict[str, Any] = {"seed": seed, "standing": standing(policy)}
    for friction in (0.5, 1.1):
        for late, substeps in (("", 0), ("_20ms_late", POLICY_DECIMATION)):
            conditions = Conditions(friction=friction, latency_substeps=substeps)
            name = f"grid_friction_{friction:g}{late}"
            table[name] = velocity_errors(policy, grid, conditions, rng)
    bumps = Conditions.mixed(len(grid), rng, rough["noise_4cm"])
    table["grid_noise_4cm"] = velocity_errors(policy, grid, bumps, rng)
    for name, config in {
        TIMED: SpeedConfig(),
        CLOSED_LOOP: SpeedConfig(end_on_displacement=True),
    }.items():
        table[name] = action_errors(policy, config, few, Conditions.mixed(few, rng), rng)
    for name, terrain in {"flat": None, **rough}.items():
        conditions = Conditions.mixed(many, rng, terrain)
        table[f"paths_{name}"] = follow_paths(policy, many, conditions, rng)
    late = replace(Conditions.mixed(many, rng), latency_substeps=LATE_SUBSTEPS)
    table["paths_60ms_late"] = follow_paths(policy, many, late, rng)
    for degrees in (5, 8):
        for name, by_speed in (("path", False), ("speed", True)):
            conditions = Conditions.mixed(4 * few, rng, ramp_terrain(degrees))
            table[f"ramps_{degrees}deg_{name}"] = follow_paths(
                policy, 4 * few, conditions, rng, by_speed
            )
    table["pushes"] = pushes(policy, many, 0.5, rng)
    table["pushes_hard"] = pushes(policy, many, 0.8, rng)
    table["posture"] = posture(policy, rng)
    every = min(max(1, round(1 / scale)), 24)
    table["stopping"] = stops(policy, rough["noise_4cm"], rng, every)
    table["stopping_plates"] = plate_stops(policy, plate_terrain(rng, 0.04), many, rng)
    table["push_standing"] = standing_pushes(policy, many, 0.5, rng)
    table["push_standing_hard"] = standing_pushes(policy, many, 0.8, rng)
    for friction in (0.4, 0.8) if policy.estimates else ():
        conditions = Conditions(friction=friction)
        table[f"estimate_friction_{friction:g}"] = velocity_errors(policy, grid, conditions, rng)
    return table


def publish(
    robot: RobotSpec,
    source: Path | None,
    target: Path | None = None,
    scale: float = 1.0,
    state: State = "true",
) -> dict[str, Any]:
    """Calibrate and evaluate the policy in `source`; write it and its card to `target`.

    Without a folder, both are where the robot's gait is installed. A calibration that it has, as
    one that anticipates has its first gait's, is kept. The table of an estimated state joins that
    of the true one, as its part `estimated`. What was learned on stairs stays with its gait alone.

    Returns:
        The evaluation table, see `evaluation_table` for `scale`.
    """
    policy = GaitPolicy.load(robot, source)
    policy = policy if policy.card.gait.aim else calibrated(policy)
    card = policy.card
    learned = stairs_files(robot, target)
    stairs = load_card(learned[1]) if learned[1].is_file() else None
    if stairs is not None and stairs.training.get("base") == card.network_sha256:
        card = replace(card, footing=stairs.footing)
        stairs = None
    if state == "estimated":
        estimated = evaluation_table(policy.estimating(), scale=scale)
        card = replace(card, evaluation=card.evaluation | {"estimated": estimated})
    else:
        card = replace(card, evaluation=evaluation_table(policy, scale=scale))
    _install(policy_files(robot, source)[0].read_bytes(), card, *policy_files(robot, target))
    if stairs is not None:
        log.warning("%s was trained on top of another gait: removed", learned[1])
        for path in learned:
            path.unlink(missing_ok=True)
    return card.evaluation


def publish_stairs(
    robot: RobotSpec, source: Path, scale: float = 1.0, seed: int = SEED, state: State = "true"
) -> dict[str, Any]:
    """Test what the robot's gait learned on stairs in the folder `source`, and install it.

    Returns:
        The table of `flights`.
    """
    policy = _on_stairs(robot, source, state)
    assert policy.stairs is not None
    table = _flights(policy, scale, seed)
    card = policy.stairs.card
    table_of = {"estimated": table} if state == "estimated" else table
    content = stairs_files(robot, source)[0].read_bytes()
    _install(content, replace(card, evaluation=card.evaluation | table_of), *stairs_files(robot))
    # Replays read the footing from the card of the level gait.
    save_card(policy.card, policy_files(robot)[1])
    return table


def _on_stairs(robot: RobotSpec, source: Path | None, state: State) -> GaitPolicy:
    """Return the installed gait with a footing, and with what it learned in the folder `source`.

    Without a folder that is what is installed, if anything.
    """
    policy = GaitPolicy.load(robot)
    if policy.card.footing is None:
        card = replace(policy.card, footing=footing(robot, policy.card.gait))
        policy = policy.changed(robot, card)
    policy = policy if source is None else policy.with_stairs(source)
    return policy.estimating() if state == "estimated" else policy


def _flights(policy: GaitPolicy, scale: float, seed: int) -> dict[str, Any]:
    return flights(policy, max(2, round(50 * scale)), np.random.default_rng(seed))


def _install(content: bytes, card: PolicyCard, path: Path, card_path: Path) -> None:
    write_bytes(path, content)
    save_card(card, card_path)


def report(evaluation: dict[str, Any]) -> str:
    """Return the gates, one line each, and the errors of discrete actions in VLN-PE's timing."""
    lines = [str(result) for result in gate_results(evaluation)]
    timed = evaluation[TIMED]
    lines.append(
        f"  (discrete actions of 0.25 s each, 90 %: {timed['position_p90_m']:.3f} m, "
        f"{timed['heading_p90_deg']:.1f}°, {timed['falls']} of {timed['robots']} robots fell)"
    )
    return "\n".join(lines)


def climbed(evaluation: dict[str, Any]) -> str:
    """Return the flights of an evaluation table, one line each riser."""
    return "\n".join(
        f"{name.removeprefix('flights_'):>5}  up {row['up_arrived']:.0%}, {row['up_falls']} fell; "
        f"down {row['down_arrived']:.0%}, {row['down_falls']} fell; {row['flights']} flights each"
        for name, row in evaluation.items()
        if name.startswith("flights_")
    )


def main(
    robot: Annotated[str, tyro.conf.Positional],
    policy: Path | None = None,
    scale: float = 1.0,
    seed: int = SEED,
    state: State = "true",
    stairs: bool = False,
    publish_it: Annotated[bool, tyro.conf.arg(name="publish")] = False,
) -> None:
    """Measure a policy and print its evaluation table and its gates.

    Args:
        robot: registry name, or the folder of a robot of one's own.
        policy: folder of `<robot>.safetensors` and `<robot>.json`; default the installed one.
        seed: of terrain, friction, paths and starts; another one shows overfitting to the first.
        scale: below 1 takes fewer robots, for a quick look.
        state: true, or estimated from the robot's sensors.
        stairs: test flights of stairs alone; `policy` is then the folder of a training on stairs. A
            gait without a footing gets the one with which that begins.
        publish_it: install the policy, with its table; with `stairs`, beside the level one.
    """
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    spec = get_robot(robot)
    if stairs:
        if publish_it and policy is None:
            raise InputError("--stairs --publish installs a --policy that was trained on stairs")
        if publish_it and policy is not None:
            table = publish_stairs(spec, policy, scale, seed, state)
        else:
            table = _flights(_on_stairs(spec, policy, state), scale, seed)
        log.info("%s", climbed(table))
        return
    if publish_it:
        evaluation = publish(spec, policy, None, scale, state)
    else:
        gait = GaitPolicy.load(spec, policy)
        gait = gait.estimating() if state == "estimated" else gait
        evaluation = evaluation_table(gait, seed, scale)
    log.info("%s\n\n%s", json.dumps(evaluation, indent=1), report(evaluation))


if __name__ == "__main__":
    try:
        tyro.cli(main)
    except VlnpeError as error:
        raise SystemExit(f"evaluate: {error}") from None
