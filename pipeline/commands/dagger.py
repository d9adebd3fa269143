"""Command `dagger`: a policy walks, the expert labels, and the walks become a dataset."""

from ...evaluation.policies.names import MODEL_POLICIES, ORACLE
from ...formats.core.errors import InputError
from ...formats.core.rollout import DAGGER
from ..collect.evaluation import chosen_trial, rendered, walk
from ..context import open_context
from ..options.evaluate import Dagger, Evaluate
from ..options.shared import settings_of
from ..report.gather import robot_rows
from ..stages.datasets import export_items as export
from ..summary import joined, print_result, robot_table, stage_table

ALL = "all"


def run(options: Dagger) -> int:
    """Walk, render and export; what is done already is reused.

    Raises:
        InputError: If a name is unknown, or a file or folder cannot be used.
    """
    if options.policy in (ORACLE, *MODEL_POLICIES):
        raise InputError(
            f"--policy {options.policy}: valid are learned policies, servers, map, random, forward"
        )
    split = None if options.split == ALL else options.split
    shared = settings_of(Evaluate, options, split=split)
    trial = chosen_trial(shared)
    identity = trial.policy.identity()
    with open_context(options.out, options) as context:
        walker, walks = walk(
            context, trial, shared, identity, label="dagger", expert_share=options.beta
        )
        dataset, frames, units = rendered(context, trial, walker.robot, walks.good(), DAGGER)
        facts = {
            "robot": trial.robot.name,
            "controller": DAGGER,
            "executed_by": trial.controller,
            "policy": identity,
            "beta": options.beta,
            "seed": options.seed,
        }
        folder = trial.folder.resolve()
        exported = export.run(context, units, folder, dataset, {"options": facts})
        summaries = [walks, frames, *exported]
        table = robot_table(robot_rows(context.ledger))
    quarantined = sum(s.quarantined for s in summaries)
    code = int(quarantined > options.max_failed)
    counts = {"stages": {s.stage: s.counts() for s in joined(summaries)}, "exit_code": code}
    text = f"\n{stage_table(summaries)}\n\n{table}\n\ndataset: {dataset.lerobot}"
    print_result(options, counts, text)
    return code
