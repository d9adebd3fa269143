"""Stage `instruct`: every path gets its texts, from what is true of it."""

from __future__ import annotations

from pathlib import Path

from ...instruction_gen.llm.brief import prompts_sha256
from ...instruction_gen.records import InstructConfig
from ..engine.ledger import Ledger, Row
from ..engine.runner import StageSummary
from ..engine.work import WorkItem, work_item
from ..jobs.instruct import InstructJob

STAGE = "instruct"


def item(
    source: Row,
    sight: Row,
    scenes: Path,
    episodes: Path,
    seen: Path,
    out: Path,
    facts: Path,
    config: InstructConfig,
    seed: int,
) -> WorkItem:
    """Write instructions for the episodes that have none, from `episodes` into `out`.

    Args:
        source: row of the stage that made `episodes`.
        sight: row of the stage that made `seen`.
        scenes: folder of the repaired scenes.
        episodes: episode file.
        seen: what the camera sees along its paths, see `stages.visibility`.
        out: episode file to write.
        facts: facts records to write.
        config: how.
        seed: of the phrasing.
    """
    prompts = prompts_sha256() if config.llm else ""
    job = InstructJob(scenes, episodes, seen, out, facts, config, seed)
    inputs = (source.key, sight.key, config, prompts, seed)
    return work_item(STAGE, source.item, job, (out, facts), *inputs)


def record_failed(ledger: Ledger, done: StageSummary) -> None:
    """Quarantine, path by path, what has no true instruction."""
    reasons = {
        name: reason
        for row in done.good().values()
        for name, reason in row.facts["quarantined"].items()
    }
    for name, reason in sorted(reasons.items()):
        error = {"type": "VlnpeError", "reason": f"no true instruction: {reason}"}
        row = Row(STAGE, f"episode {name}", "", "quarantined", error=error)
        ledger.add(row)
        done.rows.append(row)
        done.quarantined += 1
    ledger.save()
