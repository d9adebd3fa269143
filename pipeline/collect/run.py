"""The state that all stages of one run share."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from ...collectors.controllers import SpeedConfig
from ...collectors.locomotion.state import State
from ..engine.run_folder import RunFolder
from ..execution.runner import Context, StageSummary, WorkItem, run_stage


@dataclass(frozen=True)
class Run:
    """Runs stages one after another and remembers their summaries.

    Attributes:
        state: what gaits see; see `ReplayConfig`.
        actions: how the controller `speed` executes discrete actions.
        per_instruction: make files and datasets with one episode per instruction.
        summaries: of every stage that ran, in order.
    """

    folder: RunFolder
    context: Context
    seed: int
    state: State = "true"
    actions: SpeedConfig = field(default_factory=SpeedConfig)
    per_instruction: bool = False
    summaries: list[StageSummary] = field(default_factory=list)

    def stage(
        self, name: str, items: Sequence[WorkItem], scope: str = "", required: bool = False
    ) -> StageSummary:
        """Run a stage; the arguments are those of `run_stage`."""
        summary = run_stage(self.context, name, items, scope, required)
        self.summaries.append(summary)
        return summary

    def unselect(self, *stages: str) -> None:
        """Mark the rows of stages that this run does not use as not current."""
        for stage in stages:
            self.context.ledger.select(stage, "", ())
