"""Write instructions for episodes."""

import gzip
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ....formats.core.atomic import write_bytes
from ....formats.core.episode import Episode
from ....formats.scene.visibility import Visibility, read_visibility
from ....formats.vlnce.files import read_episodes, scene_stem, write_episodes
from ....formats.vlnce.groups import group_by_path, per_instruction
from ....instruction_gen.facts.named import Named, read_named
from ....instruction_gen.facts.records import PathFacts
from ....instruction_gen.instruct import InstructResult, instruct_episodes
from ....instruction_gen.llm.brief import SIGHT_PROMPTS, prompts_sha256
from ....instruction_gen.records import InstructConfig
from ...engine.work import ItemResult


@dataclass(frozen=True)
class InstructJob:
    """Write instructions for the episodes of one file that have none.

    Attributes:
        seen: What the camera sees along the paths, one record per scene; without any, the facts
            come from the map alone.
        cache: Folder of a language model's answers.
        per_instruction: Write one episode per instruction; a path then has several.
        named: What a vision-language model named in scenes without labels, one record per scene.
        vision_model: That model, "" without one.
    """

    scenes: Path
    episodes: Path
    seen: tuple[Path, ...]
    out: Path
    facts: Path
    cache: Path
    config: InstructConfig
    seed: int
    per_instruction: bool = False
    named: tuple[Path, ...] = ()
    vision_model: str = ""

    @property
    def unused_libraries(self) -> frozenset[str]:
        """The library that asks language models, unless one writes."""
        return frozenset() if self.config.llm else frozenset({"openai"})

    def run(self) -> ItemResult:
        """Instruct one file's episodes."""
        started = time.process_time()
        sources = read_episodes(self.episodes)
        sight = read_sights(self.seen)
        named = read_named(self.named)
        facts = FactsFile()
        result = instruct_episodes(
            sources, self.scenes, self.config, self.seed, sight,
            cache=self.cache, named=named, keep=facts.add,
        )  # fmt: skip
        unchanged = (
            set() if self.config.replace else {e.episode_id for e in sources if e.instruction}
        )
        written = [
            episode if episode.episode_id in unchanged else self._with_vision(episode, named)
            for episode in result.episodes
        ]
        if self.per_instruction:
            written = [
                single for path in group_by_path(written) for single in per_instruction(path)
            ]
        write_episodes(self.out, written)
        facts.write(self.facts)
        return ItemResult({**summary(result), "cpu_s": round(time.process_time() - started, 2)})

    def _with_vision(self, episode: Episode, named: Mapping[str, Named]) -> Episode:
        """Return the episode with a record of the model that named things for its texts, if any."""
        record = episode.extra.get("instruction")
        if record is None or scene_stem(episode.scene_id) not in named:
            return episode
        seen = {
            "vision_model": self.vision_model,
            "vision_prompt_sha256": prompts_sha256(SIGHT_PROMPTS),
        }
        return replace(episode, extra={**episode.extra, "instruction": {**record, **seen}})


def read_sights(paths: Sequence[Path]) -> Visibility | None:
    """Read what is seen along the paths of several scenes; None without any record."""
    return read_visibility(*paths) if paths else None


def summary(result: InstructResult) -> dict[str, Any]:
    """Return the facts of a file's instructions for the ledger and `--json`."""
    texts = [t for e in result.episodes for t in e.extra.get("instructions", [])]
    return {
        "episodes": len(result.episodes),
        "texts": len(texts),
        "unchecked": result.unchecked,
        "ambiguous": result.ambiguous,
        "quarantined": dict(result.failed),
        "unnamed_labels": result.unnamed,
        "language_model": result.usage(),
    }


class FactsFile:
    """Facts records by trajectory id, held compressed until they are written as one JSON object.

    Each is a member of its own of the gzip file, as the format allows.
    """

    def __init__(self):
        """Start without any."""
        self._members: dict[str, bytes] = {}

    def add(self, facts: PathFacts) -> None:
        """Add the record of one path."""
        record = json.dumps(facts, default=vars, separators=(",", ":"))
        self._members[facts.trajectory_id] = _member(f"{json.dumps(facts.trajectory_id)}:{record}")

    def write(self, path: Path) -> None:
        """Write all records, sorted by trajectory id."""
        members = [self._members[name] for name in sorted(self._members)]
        write_bytes(path, b"".join([_member("{"), _member(",").join(members), _member("}")]))


def _member(text: str) -> bytes:
    return gzip.compress(text.encode(), compresslevel=6, mtime=0)


def read_facts(path: Path) -> dict[str, Any]:
    """Read what `FactsFile` wrote: plain records by trajectory id."""
    return json.loads(gzip.decompress(path.read_bytes()))
