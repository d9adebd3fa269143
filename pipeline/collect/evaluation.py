"""A policy walks episodes in closed loop: the stages of an evaluation, and its results file."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...collectors.controllers import controller_for
from ...collectors.robots import RobotSpec
from ...evaluation.episode import closed_loop
from ...evaluation.motions import DISCRETE, WAYPOINTS, check_kind, controllers_for
from ...evaluation.policies.names import MAP, MAPS, MODEL_POLICIES, SERVER_FORMS
from ...evaluation.policies.registry import PolicyChoice, resolve_policy
from ...evaluation.policy import ModelUse
from ...evaluation.results import RESULTS_NAME, results_json
from ...formats.core.atomic import file_digest, write_json
from ...formats.core.errors import InputError
from ...instruction_gen.llm.settings import CACHE_NAME
from ...learning.card import Card, read_card
from ...rendering.camera.views import CameraOverrides, View
from ..context import open_context
from ..engine.ledger import Row
from ..engine.run_folder import safe_name
from ..engine.work import digest
from ..execution.runner import Context, run_stage
from ..inputs.crews import AUTO, action_timing, auto_controller, chosen_robots, keep_crews
from ..inputs.episode_file import episodes_of
from ..inputs.views import chosen_views
from ..options.evaluate import Evaluate
from ..report import policy_items as policy_report
from ..stages.datasets import export_items as export
from ..stages.evaluation import items as evaluate
from ..stages.rollouts import render_items as render
from ..stages.rollouts import replay_items as replay
from ..stages.scenes import items as repair

log = logging.getLogger(__name__)

FRAMES_PER_SECOND = 4  # of images in MCAP files: one per action in VLN-PE's timing


@dataclass(frozen=True)
class Evaluation:
    """A finished evaluation."""

    out: Path
    scenes: Path
    results: dict[str, Any]


def evaluate_policy(options: Evaluate) -> Evaluation:
    """Evaluate a policy and write its results; walks that are done already are reused."""
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
    episodes, scenes_folder = episodes_of(options.episodes, options.scenes, options.split)
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
        card: Of a learned policy, whose default camera is that of its training data.
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
