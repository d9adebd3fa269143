"""Command `dagger`: a policy walks, the expert labels, and the walks become a dataset."""

from ....evaluation.policies.names import MODEL_POLICIES, ORACLE
from ....formats.core.errors import InputError
from ...collect.evaluation import chosen_trial
from ...collect.walked_dataset import walked_dataset
from ...context import open_context
from ...options.evaluate import Dagger, Evaluate
from ...options.shared import settings_of
from ...report.gather import robot_rows
from ...summary import joined, print_result, robot_table, stage_table

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
    with open_context(options.out, options) as context:
        walked = walked_dataset(context, trial, shared, beta=options.beta)
        table = robot_table(robot_rows(context.ledger))
    quarantined = sum(s.quarantined for s in walked.stages)
    code = int(quarantined > options.max_failed)
    counts = {"stages": {s.stage: s.counts() for s in joined(walked.stages)}, "exit_code": code}
    text = f"\n{stage_table(walked.stages)}\n\n{table}\n\ndataset: {walked.dataset}"
    print_result(options, counts, text)
    return code
