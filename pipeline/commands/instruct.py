"""`vlnpe instruct`: texts for the paths of one episode file."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ...formats.vlnce.files import read_episodes, write_episodes
from ...instruction_gen.instruct import instruct_episodes
from ...instruction_gen.records import MIXED, InstructConfig
from ...instruction_gen.show import show_path
from ..jobs import instruct
from ..jobs.visibility import looked
from .chain import tell
from .collect import instruct_config


@dataclass(frozen=True)
class Instruct:
    """Write instructions for the episodes that have none."""

    episodes: tyro.conf.Positional[Path]
    """Episode file of `sample` or `align`."""
    scenes: Path
    """Folder of repaired scenes."""
    out: Path = Path("told.json.gz")
    """Episode file to write."""
    writer: str = InstructConfig.writer
    """Who writes: composer (offline), llm (any OpenAI-compatible server, see
    docs/instructions.md), or local (a GGUF model on disk)."""
    style: str = MIXED
    """natural, terse, rich, several (terse,rich), or mixed, all in turn."""
    count: int = InstructConfig.count
    """Texts per path and language."""
    language: str = "en"
    """en, zh, hi, several (en,zh); other than en needs a language model."""
    replace: bool = False
    """Also rewrite instructions that are there already."""
    robot: str = "aliengo"
    """Whose camera says what there is to see on the way, or `none`: then the map alone does, which
    is quicker."""
    max_tokens: int = 0
    """Stop asking a language model after so many tokens; 0 = any."""
    max_cost: float = 0.0
    """Stop asking after so much is spent, at the prices in the environment; 0 = any."""
    cache: Path | None = None
    """Folder of a model's answers; by default `llm_cache` beside the output."""
    facts: Path | None = None
    """Also write the facts that the texts are made from, as compressed JSON."""
    show: int = 0
    """Print a map and the texts of so many paths."""
    seed: int = 0
    """Of the phrasing."""
    max_failed: int = 0
    """Exit with code 1 when more episodes than this have no true instruction."""
    json: Annotated[bool, tyro.conf.arg(name="json")] = False
    """Print one JSON object with the summary as the last line."""


def run(options: Instruct) -> int:
    """Instruct one file's episodes; exit code 1 when too many have no true text.

    Raises:
        InputError: an option or a file is unusable.
    """
    config = instruct_config(options)
    asked = read_episodes(options.episodes)
    sight = None
    if options.robot != "none":
        sight = looked(asked, options.scenes, options.robot, config.replace)
    cache = options.cache or options.out.parent / instruct.CACHE
    told = instruct_episodes(asked, options.scenes, config, options.seed, sight, cache=cache)
    write_episodes(options.out, told.episodes)
    if options.facts is not None:
        instruct.write_facts(options.facts, told.facts)
    if not options.json:
        shown = [e for e in told.episodes if e.trajectory_id in told.facts][: options.show]
        for episode in shown:
            sys.stdout.write(show_path(episode, told.facts[episode.trajectory_id]) + "\n\n")
        sys.stdout.writelines(f"no true text for {k}: {v}\n" for k, v in told.failed.items())
        for label, count in told.unnamed.items():
            sys.stdout.write(f"no noun is known for the label {label!r} ({count} objects)\n")
    facts = instruct.summary(told)
    tell(options, facts, f"{options.out}: {facts['episodes']} episodes, {facts['texts']} texts")
    return int(len(told.failed) > options.max_failed)
