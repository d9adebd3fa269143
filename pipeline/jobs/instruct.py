"""Write instructions for episodes."""

from __future__ import annotations

import gzip
import json
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ...formats.core.atomic import write_bytes
from ...formats.scene.visibility import read_visibility
from ...formats.vlnce.files import read_episodes, write_episodes
from ...instruction_gen.instruct import InstructResult, instruct_episodes
from ...instruction_gen.records import InstructConfig
from ..engine.work import ItemResult

CACHE = "llm_cache"  # in the run folder: answers that were paid for


@dataclass(frozen=True)
class InstructJob:
    """Write instructions for the episodes of one file that have none.

    Attributes:
        scenes: folder of the repaired scenes.
        episodes: episode file.
        seen: what the camera sees along the paths.
        out: episode file to write.
        facts: facts records to write.
        config: how.
        seed: of the phrasing.
    """

    scenes: Path
    episodes: Path
    seen: Path
    out: Path
    facts: Path
    config: InstructConfig
    seed: int

    def run(self) -> ItemResult:
        """Instruct one file's episodes."""
        started = time.process_time()
        asked = read_episodes(self.episodes)
        sight = read_visibility(self.seen)
        cache = self.out.parents[2] / CACHE
        result = instruct_episodes(asked, self.scenes, self.config, self.seed, sight, cache=cache)
        write_episodes(self.out, result.episodes)
        write_facts(self.facts, result.facts)
        return ItemResult({**summary(result), "cpu_s": round(time.process_time() - started, 2)})


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
