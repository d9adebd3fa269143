"""A policy walks episodes in closed loop: the stages of an evaluation, and its results file."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...collectors.controllers import controller_for
from ...collectors.replay.suits import check_suits
from ...collectors.robots import RobotSpec
from ...evaluation.episode import closed_loop
from ...evaluation.motions import DISCRETE, WAYPOINTS, check_kind, controllers_for
from ...evaluation.policies.names import MAP, MAPS, MODEL_POLICIES, SERVER_FORMS
from ...evaluation.policies.registry import PolicyChoice, resolve_policy
from ...evaluation.policy import ModelUse
from ...evaluation.results import RESULTS_NAME, results_json
from ...formats.core.atomic import file_digest, write_json
from ...formats.core.episode import Episode
from ...formats.core.errors import InputError
from ...formats.core.rollout import DAGGER
from ...instruction_gen.llm.settings import CACHE_NAME
from ...learning.card import Card, read_card
from ...rendering.camera.views import CameraOverrides, View
from ..context import open_context
from ..engine.ledger import Row
from ..engine.rows import StageSummary
from ..engine.run_folder import safe_name
from ..engine.work import WorkItem, digest
from ..execution.runner import Context, run_stage
from ..inputs.builtin import building_of
from ..inputs.crews import AUTO, action_timing, auto_controller, chosen_robots, keep_crews
from ..inputs.episode_file import episodes_of
from ..inputs.views import chosen_views
from ..options.evaluate import Evaluate
from ..report import policy_items as policy_report
from ..stages.datasets import export_items as export
from ..stages.evaluation import items as evaluate
from ..stages.rollouts import render_items as render
from ..stages.rollouts import replay_items as replay
from ..stages.rollouts.replay_job import Walker
from ..stages.scenes import items as repair

log = logging.getLogger(__name__)

FRAMES_PER_SECOND = 4  # of images in MCAP files: one per action in VLN-PE's timing


@dataclass(frozen=True)
class Evaluation:
    """A finished evaluation."""

    out: Path
    scenes: Path
    results: dict[str, Any]


@dataclass(frozen=True)
class Trial:
    """A policy, what carries its actions out, and the episodes that it walks.

    Attributes:
        scenes: rows of the repair stage by scene id.
        folder: folder of the repaired scenes.
    """

    policy: PolicyChoice
    robot: RobotSpec
    controller: str
    view: View
    episodes: Sequence[Episode]
    scenes: Mapping[str, Row]
    folder: Path


def chosen_trial(options: Evaluate) -> Trial:
    """Return what the options of an evaluation mean; warn if a policy was trained on other things.

    Raises:
        InputError: If a name is unknown, a file or folder cannot be used, or the robot cannot walk
            the episodes.
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
    episodes, folder = episodes_of(options.episodes, options.scenes, options.split)
    episodes = episodes[: options.limit]
    if card is not None:
        test = {"robot": robot.name, "controller": controller, "light": options.light}
        _warn_of_other_training(policy.name, card, test, episodes)
    check_suits(robot, episodes)
    scenes = repair.rows_of(folder)
    repair.demand({e.scene_id for e in episodes}, scenes, folder)
    return Trial(policy, robot, controller, view, episodes, scenes, folder)


def walk(
    context: Context,
    trial: Trial,
    options: Evaluate,
    identity: str,
    *,
    label: str,
    expert_share: float | None = None,
) -> tuple[Walker, StageSummary]:
    """Let the policy walk the episodes, alone or with the expert.

    Args:
        identity: See `PolicyChoice.identity`.
        label: Of the progress bar.
        expert_share: See `EvaluateJob`.
    """
    root = context.ledger.root
    (crew,) = keep_crews([(trial.robot, trial.controller)], context.ledger)
    timing = action_timing(options.action_steps, options.closed_loop)
    walker = replay.walker(*crew, options.seed, timing, options.state)
    walker = replace(walker, config=closed_loop(walker.config))
    items = evaluate.items(
        trial.episodes,
        trial.scenes,
        trial.folder.resolve(),
        root,
        walker=walker,
        policy=trial.policy,
        identity=identity,
        view=trial.view,
        actions=options.actions,
        expert_share=expert_share,
    )
    name = trial.controller if expert_share is None else DAGGER
    summary = run_stage(context, evaluate.STAGE, items, f"{trial.robot.name}/{name}/", label=label)
    context.ledger.record_new(root / "models")
    return walker, summary


def rendered(
    context: Context,
    trial: Trial,
    robot: RobotSpec,
    rows: Mapping[str, Row],
    label: str,
    *,
    mcap: bool = True,
) -> tuple[export.Dataset, StageSummary, dict[str, list[WorkItem]]]:
    """Render what the policy saw; return the dataset's folders, the frames and what exports them.

    Args:
        rows: Of walks.
        label: Their controller, in the dataset's name.
        mcap: Export MCAP files, too.
    """
    root, folder = context.ledger.root, trial.folder.resolve()
    dataset = export.Dataset.under(root, robot.name, label, trial.view.name)
    recorded = render.Recorded(robot, rows, root, trial.scenes, folder)
    items = render.items(recorded, trial.view, FRAMES_PER_SECOND, root / "frames", root)
    frames = run_stage(context, render.STAGE, items, dataset.scope)
    units = export.items(frames.good(), root, folder, dataset, robot, mcap=mcap)
    return dataset, frames, units


def evaluate_policy(options: Evaluate) -> Evaluation:
    """Evaluate a policy and write its results; walks that are done already are reused."""
    trial = chosen_trial(options)
    policy, robot, view, episodes = trial.policy, trial.robot, trial.view, trial.episodes
    out = options.out or _default_out(options, trial)
    use = ModelUse(out.resolve() / CACHE_NAME, options.max_tokens, options.max_cost)
    policy = replace(policy, use=use)
    trial = replace(trial, policy=policy)
    identity = policy.identity()
    with open_context(out, options) as context:
        root = context.ledger.root
        walker, summary = walk(context, trial, options, identity, label="evaluate")
        rows = sorted(summary.good().values(), key=lambda row: row.item)
        walks = [{k: v for k, v in row.facts.items() if k != "actions"} for row in rows]
        failed = {
            r.item: str(r.error.get("reason", "")) for r in summary.rows if r.status != "done"
        }
        setting = {
            "policy": policy.name,
            "policy_version": identity,
            "robot": robot.name,
            "controller": trial.controller,
            "actions": options.actions,
            "view": view.name,
            "renderer": ",".join(
                sorted(set(evaluate.renderers(episodes, trial.folder, view.renderer).values()))
            ),
            "seed": options.seed,
            "action_steps": options.action_steps,
            "closed_loop": options.closed_loop,
            "splits": sorted({e.split for e in episodes}),
            "gait_sha256": replay.gait_digest(walker),
            "code_sha256": evaluate.code_digest(),
            "episodes_sha256": digest([(e.split, e.scene_id, e.episode_id) for e in episodes]),
            "instructions_sha256": digest([e.instruction for e in episodes]),
        }
        value = results_json(setting, walks, failed)
        write_json(out / RESULTS_NAME, value)
        context.ledger.record([root / RESULTS_NAME])
        if policy.name in MODEL_POLICIES:
            context.ledger.record_new(root / CACHE_NAME)
        if options.mcap:
            dataset, _, exports = rendered(
                context, trial, walker.robot, summary.good(), trial.controller
            )
            run_stage(context, export.MCAP_STAGE, exports[export.MCAP_STAGE], dataset.scope)
        if options.films > 0:
            policy_report.write(
                context,
                rows,
                value,
                robot=walker.robot,
                view=view,
                scenes=trial.folder.resolve(),
                films=options.films,
            )
    return Evaluation(out, trial.folder, value)


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
        camera = card.view.camera
    views = chosen_views(camera, options.light, options.renderer, robot, overrides)
    if len(views) != 1 or views[0].kind != "ego":
        raise InputError(
            f"--camera {options.camera} --light {options.light}: a policy has one camera, the "
            "robot's own (ego) or a rig, under one light"
        )
    return robot, controller, views[0]


def _warn_of_other_training(
    policy: str, card: Card, test: Mapping[str, str], episodes: Sequence[Episode]
) -> None:
    """Warn if a learned policy is tested with what it was not trained on."""
    trained = {"robot": card.robots, "controller": card.controllers, "light": card.lights}
    for name, value in test.items():
        if trained[name] and value not in trained[name]:
            valid = ", ".join(trained[name])
            log.warning("%s was trained on %s %s, not on %s", policy, name, valid, value)
    if card.stairs is False and (count := sum(bool(e.staircases) for e in episodes)):
        of = len(episodes)
        log.warning("%s was trained on no stairs, and %d of %d paths take some", policy, count, of)
    known = {building_of(scene) for scene in card.scenes}
    aside = card.held_out.get("trajectories", ())
    seen = [building_of(e.scene_id) for e in episodes if building_of(e.scene_id) in known
            and f"{e.scene_id}/{e.trajectory_id}" not in aside]  # fmt: skip
    if seen:
        log.warning(
            "%s was trained in %s, where %d of %d paths are: that says nothing of other buildings",
            policy, ", ".join(sorted(set(seen))), len(seen), len(episodes),
        )  # fmt: skip


def _default_out(options: Evaluate, trial: Trial) -> Path:
    path = trial.policy.checkpoint
    label = f"{path.stem}-{file_digest(path)[:6]}" if path else trial.policy.name
    moved = f"-{trial.view.rig.name}" if trial.view.rig else ""
    name = f"{label}-{trial.robot.name}-{trial.controller}{moved}-{options.light}"
    base = options.episodes if options.episodes.is_dir() else Path("runs")
    return base / "evaluations" / safe_name(name)
