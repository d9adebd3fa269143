"""Walks of a policy become a dataset: walk, render, export."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...evaluation.policies.names import ORACLE
from ...formats.core.rollout import DAGGER
from ..engine.rows import StageSummary
from ..execution.runner import Context
from ..options.evaluate import Evaluate
from ..stages.datasets import export_items as export
from .evaluation import Trial, rendered, walk


@dataclass(frozen=True)
class Walked:
    """Dataset of walks.

    Attributes:
        dataset: its folder; missing if no walk could be made.
        stages: what each stage did.
    """

    dataset: Path
    stages: Sequence[StageSummary]


def walked_dataset(
    context: Context,
    trial: Trial,
    options: Evaluate,
    *,
    beta: float | None = None,
    mcap: bool = True,
) -> Walked:
    """Let a policy walk episodes, and export what it saw; what is done already is reused.

    Args:
        context: Of the output folder.
        options: Settings of the walks, as for an evaluation.
        beta: Share of the actions that the expert takes while it labels all of them (DAgger); None
            lets the policy walk alone.
        mcap: Write MCAP files, too.
    """
    identity = trial.policy.identity()
    label = trial.controller if beta is None else DAGGER
    name = "expert" if trial.policy.name == ORACLE else label
    walker, walks = walk(context, trial, options, identity, label=name, expert_share=beta)
    dataset, frames, units = rendered(context, trial, walker.robot, walks.good(), label, mcap=mcap)
    facts = {
        "robot": trial.robot.name,
        "controller": label,
        "executed_by": trial.controller,
        "policy": identity,
        "beta": beta,
        "seed": options.seed,
    }
    exported = export.run(context, units, trial.folder.resolve(), dataset, {"options": facts})
    return Walked(dataset.lerobot, [walks, frames, *exported])
