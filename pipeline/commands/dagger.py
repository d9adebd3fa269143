"""Command `dagger`: a policy walks, the expert labels, and the walks become a dataset."""

from dataclasses import replace

from ...evaluation.episode import closed_loop
from ...evaluation.motions import DISCRETE
from ...evaluation.policies.names import MODEL_POLICIES, ORACLE
from ...evaluation.policies.registry import resolve_policy
from ...formats.core.errors import InputError
from ...formats.core.rollout import DAGGER
from ...learning.card import read_card
from ..collect.evaluation import FRAMES_PER_SECOND, chosen_test
from ..context import open_context
from ..execution.runner import run_stage
from ..inputs.crews import action_timing, keep_crews
from ..inputs.episode_file import episodes_of
from ..options.evaluate import Dagger, Evaluate
from ..options.shared import settings_of
from ..report.gather import robot_rows
from ..stages.datasets import export_items as export
from ..stages.evaluation import items as evaluate
from ..stages.rollouts import render_items as render
from ..stages.rollouts import replay_items as replay
from ..stages.scenes import items as repair
from ..summary import joined, print_result, robot_table, stage_table

ALL = "all"


def run(options: Dagger) -> int:
    """Walk, render and export; what is done already is reused.

    Raises:
        InputError: If a name is unknown, or a file or folder cannot be used.
    """
    policy = resolve_policy(options.policy, options.timeout_s)
    if policy.name in (ORACLE, *MODEL_POLICIES):
        raise InputError(
            f"--policy {policy.name}: valid are learned policies, servers, map, random, forward"
        )
    card = read_card(policy.checkpoint)[0] if policy.checkpoint else None
    robot, controller, view = chosen_test(settings_of(Evaluate, options), card)
    split = None if options.split == ALL else options.split
    episodes, scenes_folder = episodes_of(options.episodes, options.scenes, split)
    episodes = episodes[: options.limit]
    scenes = repair.rows_of(scenes_folder)
    repair.demand({e.scene_id for e in episodes}, scenes, scenes_folder)
    identity = policy.identity()
    folder = scenes_folder.resolve()
    with open_context(options.out, options) as context:
        root = context.ledger.root
        (crew,) = keep_crews([(robot, controller)], context.ledger)
        walker = replay.walker(
            *crew, options.seed, action_timing(options.action_steps, options.closed_loop)
        )
        walker = replace(walker, config=closed_loop(walker.config))
        items = evaluate.items(
            episodes,
            scenes,
            folder,
            root,
            walker=walker,
            policy=policy,
            identity=identity,
            view=view,
            actions=DISCRETE,
            expert_share=options.beta,
        )
        dataset = export.Dataset.under(root, robot.name, DAGGER, view.name)
        walks = run_stage(context, replay.STAGE, items, f"{robot.name}/{DAGGER}/", label="dagger")
        context.ledger.record_new(root / "models")
        recorded = render.Recorded(walker.robot, walks.good(), root, scenes, folder)
        pictures = render.items(recorded, view, FRAMES_PER_SECOND, root / "frames", root)
        frames = run_stage(context, render.STAGE, pictures, dataset.scope)
        units = export.items(frames.good(), root, folder, dataset, walker.robot)
        facts = {
            "robot": robot.name,
            "controller": DAGGER,
            "executed_by": controller,
            "policy": identity,
            "beta": options.beta,
            "seed": options.seed,
        }
        summaries = [
            walks,
            frames,
            *export.run(context, units, folder, dataset, {"options": facts}),
        ]
        table = robot_table(robot_rows(context.ledger))
    quarantined = sum(s.quarantined for s in summaries)
    code = int(quarantined > options.max_failed)
    counts = {"stages": {s.stage: s.counts() for s in joined(summaries)}, "exit_code": code}
    text = f"\n{stage_table(summaries)}\n\n{table}\n\ndataset: {dataset.lerobot}"
    print_result(options, counts, text)
    return code
