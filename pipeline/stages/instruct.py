"""Stage `instruct`: every path gets its texts, from what is true of it."""

from __future__ import annotations

import gzip
import json
import time
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...formats.core.atomic import write_bytes
from ...formats.scene.visibility import read_visibility
from ...formats.vlnce.files import read_episodes, write_episodes
from ...instruction_gen.instruct import InstructResult, instruct_episodes
from ...instruction_gen.llm.brief import prompts_sha256
from ...instruction_gen.records import InstructConfig
from ..engine.keys import code_version, digest
from ..engine.ledger import Ledger, Row
from ..engine.runner import ItemResult, StageSummary, WorkItem

STAGE = "instruct"
CACHE = "llm_cache"  # in the run folder: answers that were paid for
CODE = ("instruction_gen", "wayfinding", "formats", "pipeline/stages/instruct.py")


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
    key = digest(STAGE, source.key, sight.key, config, prompts, seed, code_version(*CODE))
    arguments = (scenes, episodes, seen, out, facts, config, seed)
    return WorkItem(source.item, key, (out, facts), process, arguments)


def process(
    scenes: Path,
    episodes: Path,
    seen: Path | None,
    out: Path,
    facts: Path | None,
    config: InstructConfig,
    seed: int,
) -> ItemResult:
    """Instruct one file's episodes."""
    started = time.process_time()
    asked = read_episodes(episodes)
    sight = read_visibility(seen) if seen else None
    told = instruct_episodes(asked, scenes, config, seed, sight, cache=out.parents[2] / CACHE)
    write_episodes(out, told.episodes)
    if facts is not None:
        write_facts(facts, told.facts)
    return ItemResult({**summary(told), "cpu_s": round(time.process_time() - started, 2)})


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


def summary(told: InstructResult) -> dict[str, Any]:
    """What the ledger and `--json` say of a file's instructions."""
    texts = [t for e in told.episodes for t in e.extra.get("instructions", [])]
    return {
        "episodes": len(told.episodes),
        "texts": len(texts),
        "skeletons": len(told.skeletons),
        "quarantined": dict(told.failed),
        "unnamed_labels": told.unnamed,
        "language_model": told.usage(),
    }


def write_facts(path: Path, facts: Mapping[str, Any]) -> None:
    """Write facts records by trajectory id, as compressed JSON."""
    document = {name: asdict(one) for name, one in sorted(facts.items())}
    data = json.dumps(document, separators=(",", ":")).encode()
    write_bytes(path, gzip.compress(data, compresslevel=6, mtime=0))
