"""Stage `instruct`: write the instructions of every path."""

from ....instruction_gen.llm.brief import prompts_sha256
from ...engine.ledger import Ledger
from ...engine.work import WorkItem, work_item
from ...execution.runner import StageSummary
from .instruct_job import InstructJob

STAGE = "instruct"


def item(name: str, job: InstructJob, *made_of: str) -> WorkItem:
    """Write instructions for the episodes of one file.

    Args:
        made_of: Keys of the items that made the episodes and the records of what is seen.
    """
    prompts = prompts_sha256() if job.config.llm else ""
    how = {"prompts": prompts, "seed": job.seed}
    return work_item(STAGE, name, job, (job.out, job.facts), *made_of, job.config, **how)


def record_failed(ledger: Ledger, done: StageSummary) -> None:
    """Quarantine every path that has no true instruction."""
    reasons = {
        name: reason
        for row in done.good().values()
        for name, reason in row.facts["quarantined"].items()
    }
    for name, reason in sorted(reasons.items()):
        reason = f"no true instruction: {reason}"
        ledger.add(done.quarantined_episode(name, "VlnpeError", reason))
    ledger.save()
