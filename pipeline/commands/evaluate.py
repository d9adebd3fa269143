"""Commands for closed loop: `evaluate` and `compare`."""

import json
import logging
import shlex
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from math import isnan
from pathlib import Path
from typing import Any

from ...collectors.controllers import controller_for
from ...collectors.robots import RobotSpec
from ...evaluation.episode import closed_loop
from ...evaluation.motions import DISCRETE, WAYPOINTS, check_kind, controllers_for
from ...evaluation.policy import ModelUse
from ...evaluation.policy_names import MAP, MAPS, MODEL_POLICIES, SERVER_FORMS
from ...evaluation.policy_registry import PolicyChoice, resolve_policy
from ...evaluation.results import (
    COLUMNS,
    COUNTS,
    LEGEND,
    RESULTS_NAME,
    compare,
    decimals,
    grouped,
    interval_json,
    read_results,
    results_json,
    table,
)
from ...evaluation.statistics import LEAST_PATHS
from ...formats.core.atomic import file_digest, write_json
from ...formats.core.checkout import program
from ...formats.core.errors import InputError
from ...instruction_gen.llm.settings import CACHE_NAME
from ...learning.card import Card, read_card
from ...rendering.camera.views import CameraOverrides, View
from ..context import open_context
from ..engine.ledger import Row
from ..engine.run_folder import safe_name
from ..engine.runner import Context, run_stage
from ..engine.work import digest
from ..inputs.crews import AUTO, action_timing, auto_controller, chosen_robots, keep_crews
from ..inputs.episode_file import asked_episodes
from ..inputs.views import chosen_views
from ..options.evaluate import Compare, Evaluate
from ..stages.datasets import export_items as export
from ..stages.evaluation import items as evaluate
from ..stages.evaluation import report_items as policy_report
from ..stages.rollouts import render_items as render
from ..stages.rollouts import replay_items as replay
from ..stages.scenes import items as repair

log = logging.getLogger(__name__)

FRAMES_PER_SECOND = 4  # of images in MCAP files: one per action in VLN-PE's timing


@dataclass(frozen=True)
class Evaluation:
    """A finished evaluation.

    Attributes:
        out: its folder.
        scenes: folder of the repaired scenes.
        results: content of its results file.
    """

    out: Path
    scenes: Path
    results: dict[str, Any]


def run_evaluate(options: Evaluate) -> int:
    """Evaluate a policy and print its results.

    Raises:
        InputError: If a name is unknown, or a file or folder cannot be used.
    """
    evaluation = evaluate_policy(options)
    _print(options, evaluation)
    return int(len(evaluation.results["quarantined"]) > options.max_failed)


def evaluate_policy(options: Evaluate) -> Evaluation:
    """Evaluate a policy and write its results; walks that are done already are reused.

    Raises:
        InputError: If a name is unknown, or a file or folder cannot be used.
    """
    policy = resolve_policy(options.policy, options.timeout_s)
    maps = policy.name in MAPS and options.actions == WAYPOINTS
    if options.actions != DISCRETE and not (policy.is_server or maps):
        raise InputError(
            f"--actions {options.actions}: policy {policy.name} outputs {DISCRETE} actions; "
            f"valid: {DISCRETE}, --policy {' or '.join(SERVER_FORMS)}, "
            f"or {WAYPOINTS} of --policy {MAP}"
        )
    card = read_card(policy.checkpoint)[0] if policy.checkpoint else None
    robot, controller, view = chosen_test(options, card)
    options = replace(options, controller=controller)
    if card is not None:
        test = {"robot": robot.name, "controller": controller, "light": options.light}
        _warn_of_other_training(policy.name, card, test)
    episodes, scenes_folder = asked_episodes(options.episodes, options.scenes, options.split)
    episodes = episodes[: options.limit]
    scenes = repair.rows_of(scenes_folder)
    repair.demand({e.scene_id for e in episodes}, scenes, scenes_folder)
    out = options.out or _default_out(options, policy, robot.name, view)
    use = ModelUse(out.resolve() / CACHE_NAME, options.max_tokens, options.max_cost)
    policy = replace(policy, use=use)
    identity = policy.identity()
    actions = action_timing(options.action_steps, options.closed_loop)
    with open_context(out, options) as context:
        root = context.ledger.root
        (crew,) = keep_crews([(robot, options.controller)], context.ledger)
        walker = replay.walker(*crew, options.seed, actions)
        walker = replace(walker, config=closed_loop(walker.config))
        items = evaluate.items(
            episodes,
            scenes,
            scenes_folder.resolve(),
            root,
            walker=walker,
            policy=policy,
            identity=identity,
            view=view,
            actions=options.actions,
        )
        scope = f"{robot.name}/{options.controller}/"
        summary = run_stage(context, evaluate.STAGE, items, scope, label="evaluate")
        rows = sorted(summary.good().values(), key=lambda row: row.item)
        walks = [{k: v for k, v in row.facts.items() if k != "actions"} for row in rows]
        failed = {
            r.item: str(r.error.get("reason", "")) for r in summary.rows if r.status != "done"
        }
        setting = {
            "policy": policy.name,
            "policy_version": identity,
            "robot": robot.name,
            "controller": options.controller,
            "actions": options.actions,
            "view": view.name,
            "renderer": ",".join(
                sorted(set(evaluate.renderers(episodes, scenes_folder, view.renderer).values()))
            ),
            "seed": options.seed,
            "action_steps": options.action_steps,
            "closed_loop": options.closed_loop,
            "splits": sorted({e.split for e in episodes}),
            "gait_sha256": replay.gait_digest(walker),
            "episodes_sha256": digest([(e.split, e.scene_id, e.episode_id) for e in episodes]),
            "instructions_sha256": digest([e.instruction for e in episodes]),
        }
        value = results_json(setting, walks, failed)
        write_json(out / RESULTS_NAME, value)
        context.ledger.record([root / RESULTS_NAME])
        context.ledger.record_new(root / "models")
        if policy.name in MODEL_POLICIES:
            context.ledger.record_new(root / CACHE_NAME)
        folder = scenes_folder.resolve()
        if options.mcap:
            _write_mcap(context, walker.robot, summary.good(), scenes, folder, view)
        if options.films > 0:
            policy_report.write(
                context,
                rows,
                value,
                robot=walker.robot,
                view=view,
                scenes=folder,
                films=options.films,
            )
    return Evaluation(out, scenes_folder, value)


def chosen_test(options: Evaluate, card: Card | None) -> tuple[RobotSpec, str, View]:
    """Return the robot, the controller and the camera that a policy is tested with.

    Args:
        options: The command's.
        card: Of a learned policy, whose default camera is that of its training data.

    Raises:
        InputError: If a name is unknown, or robot, controller, camera and light do not suit each
            other.
    """
    robots = chosen_robots(options.robot)
    if len(robots) != 1:
        raise InputError(f"--robot {options.robot}: an evaluation runs one robot")
    (robot,) = robots
    controller = options.controller
    if controller == AUTO:
        controller = auto_controller(robot, controllers_for(options.actions), "speed")
    controller_for(robot, controller)
    check_kind(options.actions, controller)
    overrides = CameraOverrides(height_m=options.camera_height, pitch_down_deg=options.camera_pitch)
    camera = options.camera
    if card is not None and camera == Evaluate.camera:
        camera = card.view.camera(camera)
    views = chosen_views(camera, options.light, options.renderer, robot, overrides)
    if len(views) != 1 or views[0].kind != "ego":
        raise InputError(
            f"--camera {options.camera} --light {options.light}: a policy has one camera, the "
            "robot's own (ego), under one light"
        )
    return robot, controller, views[0]


def _write_mcap(
    context: Context,
    robot: RobotSpec,
    rows: Mapping[str, Row],
    scenes: Mapping[str, Row],
    folder: Path,
    view: View,
) -> None:
    """Render what the policy saw and write an MCAP file per episode, with images."""
    root = context.ledger.root
    for controller in sorted({item.split("/")[1] for item in rows}):
        dataset = export.Dataset.under(root, robot.name, controller, view.name)
        recorded = render.Recorded(robot, rows, root, scenes, folder)
        items = render.items(recorded, view, FRAMES_PER_SECOND, root / "frames", root)
        frames = run_stage(context, render.STAGE, items, dataset.scope).good()
        items = export.items(frames, root, folder, dataset, robot)[export.MCAP_STAGE]
        run_stage(context, export.MCAP_STAGE, items, dataset.scope)


def run_compare(options: Compare) -> int:
    """Compare two evaluations.

    Raises:
        InputError: If a file is no results file, or they have no episode in common.
    """
    names = (str(options.first), str(options.second))
    comparison = compare(read_results(options.first), read_results(options.second), names)
    if options.json:
        differences = {name: interval_json(v) for name, v in comparison.differences.items()}
        value = {**asdict(comparison), "differences": differences}
        sys.stdout.write(json.dumps(value, allow_nan=False) + "\n")
        return 0
    lines = [f"warning: {text}" for text in comparison.warnings]
    lines += [
        f"{comparison.common} episodes in both, {comparison.apart} in one only",
        f"only {names[0]} succeeds: {len(comparison.lost)}  {', '.join(comparison.lost[:10])}",
        f"only {names[1]} succeeds: {len(comparison.won)}  {', '.join(comparison.won[:10])}",
        f"McNemar's exact test: p = {comparison.p_value:.3g}",
        "",
    ]
    few = all(isnan(change.low) for change in comparison.differences.values())
    interval = (
        f"mean (no interval of fewer than {LEAST_PATHS} paths)" if few else "mean and 95 % interval"
    )
    lines.append(f"second minus first, {interval} of the paired difference; % are points")
    for name, change in comparison.differences.items():
        d = decimals(name)
        bounds = "" if isnan(change.low) else f" ({change.low:+.{d}f} to {change.high:+.{d}f})"
        lines.append(f"  {name:<5} {change.mean:+8.{d}f} {COLUMNS[name][0]:<2}{bounds}".rstrip())
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


def _warn_of_other_training(policy: str, card: Card, test: Mapping[str, str]) -> None:
    """Warn if a learned policy is tested with what it was not trained on."""
    trained = {"robot": card.robots, "controller": card.controllers, "light": card.lights}
    for name, value in test.items():
        if trained[name] and value not in trained[name]:
            valid = ", ".join(trained[name])
            log.warning("%s was trained on %s %s, not on %s", policy, name, valid, value)


def _default_out(options: Evaluate, policy: PolicyChoice, robot: str, view: View) -> Path:
    path = policy.checkpoint
    label = f"{path.stem}-{file_digest(path)[:6]}" if path else policy.name
    name = f"{label}-{robot}-{options.controller}{view.moved}-{options.light}"
    base = options.episodes if options.episodes.is_dir() else Path("runs")
    return base / "evaluations" / safe_name(name)


def _print(options: Evaluate, evaluation: Evaluation) -> None:
    out, value, scenes = evaluation.out, evaluation.results, evaluation.scenes
    if options.json:
        shown = {k: value[k] for k in ("setting", "summary", "quarantined")} | {"out": str(out)}
        sys.stdout.write(json.dumps(shown) + "\n")
        return
    groups = grouped(value["episodes"], "split")
    if len(groups) > 1:
        groups["all"] = value["episodes"]
    who = value["setting"]
    head = f"policy {who['policy']} drives {who['robot']} ({who['controller']})"
    text = f"{table(groups)}\n\n{LEGEND}" if value["episodes"] else "no episode has a result"
    sys.stdout.write(f"\n{head}\n{text}\n\n")
    if value["quarantined"]:
        count = len(value["quarantined"])
        reason = next(iter(value["quarantined"].values()))
        sys.stdout.write(f"{count} episodes without a result, counted apart: {reason}\n")
    for count, what in COUNTS.items():
        if total := sum(episode.get(count, 0) for episode in value["episodes"]):
            sys.stdout.write(f"{total} {what}\n")
    sys.stdout.write(f"results: {out / RESULTS_NAME}\n")
    if options.films > 0:
        sys.stdout.write(f"report:  {out / policy_report.PAGE_NAME}\n")
        return
    walks, films = shlex.quote(str(out)), shlex.quote(str(out / "films"))
    sys.stdout.write(
        'films:   the same command with --films 2 (of make: ARGS="--films 2"), or\n'
        f"         {program()} render {walks} --scenes {shlex.quote(str(scenes))} --video "
        f"--camera chase --out {films}\n"
    )
