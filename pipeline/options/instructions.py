"""Options of the commands for instructions: `instruct`, `review`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from . import Json


@dataclass(frozen=True)
class Instruct:
    """Write instructions for the episodes that have none."""

    episodes: tyro.conf.Positional[Path]
    """Episode file of `sample` or `align`."""
    scenes: Path
    """Folder of repaired scenes."""
    out: Path = Path("instructed.json.gz")
    """Episode file to write."""
    writer: str = "composer"
    """Writer: composer (offline), llm (any OpenAI-compatible server, see
    docs/instructions.md), or local (a GGUF model on disk)."""
    style: str = "mixed"
    """Styles: natural, terse, rich, a comma-separated list (terse,rich), or mixed, which
    alternates between all."""
    count: int = 3
    """Number of texts per path and language."""
    language: str = "en"
    """Languages: en, zh, hi, or a comma-separated list (en,zh). Languages other than en need a
    language model."""
    replace: bool = False
    """Also rewrite existing instructions."""
    per_instruction: bool = False
    """Write one episode per instruction. By default a path is one episode that carries all."""
    robot: str = "aliengo"
    """Robot whose camera determines which landmarks are visible along the path, or `none` to use
    the map alone, which is faster."""
    vision: bool = False
    """In scenes without labels, let a vision-language model name what the camera sees (the same
    environment variables as --writer llm)."""
    max_tokens: int = 0
    """Stop querying the language model after this many tokens; 0 means no limit."""
    max_cost: float = 0.0
    """Stop querying after this cost, at the prices set in the environment; 0 means no limit."""
    cache: Path | None = None
    """Cache folder for model responses; default `llm_cache` next to the output."""
    facts: Path | None = None
    """Also write the facts records behind the texts, as compressed JSON."""
    show: int = 0
    """Print a map and the texts for this many paths."""
    seed: int = 0
    """Random seed of the phrasing."""
    workers: int = 0
    """Number of worker processes; 0 uses one per core."""
    max_failed: int = 0
    """Maximum number of episodes without a valid instruction; exit with code 1 above it."""
    json: Json = False
    """Print one JSON object with the summary as the last line."""


@dataclass(frozen=True)
class Review:
    """Review the instructions of a run on a local page (127.0.0.1); decisions apply at export."""

    run: tyro.conf.Positional[Path]
    """A run folder, or an episode file of `instruct` (then --scenes is required)."""
    scenes: Path | None = None
    """Folder of repaired scenes; by default the run's."""
    decisions: Path | None = None
    """Append-only file of decisions; by default review.jsonl in the run folder, or beside the
    file."""
    port: int = 0
    """Port of the page; 0 selects a free one."""
    open: bool = False
    """Open the page in the default browser."""
