"""`vlnpe instruct`: texts for the paths of one episode file."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ...collectors.robots import get_robot
from ...formats.core.episode import Episode
from ...formats.scene.bundle import LabeledObject
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
    """Writer: composer (offline), llm (any OpenAI-compatible server, see
    docs/instructions.md), or local (a GGUF model on disk)."""
    style: str = MIXED
    """Styles: natural, terse, rich, a comma-separated list (terse,rich), or mixed, which takes all
    in turn."""
    count: int = InstructConfig.count
    """Number of texts per path and language."""
    language: str = "en"
    """Languages: en, zh, hi, or a comma-separated list (en,zh). Languages other than en need a
    language model."""
    replace: bool = False
    """Also rewrite existing instructions."""
    robot: str = "aliengo"
    """Robot whose camera determines which landmarks are visible along the path, or `none` to use
    the map alone, which is faster."""
    vision: bool = False
    """In scenes without labels, let a vision-language model name what the camera sees (same
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
    objects = _seen_objects(options, asked, cache) if options.vision else None
    told = instruct_episodes(
        asked, options.scenes, config, options.seed, sight, cache=cache, objects=objects
    )
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


def _seen_objects(
    options: Instruct, episodes: Sequence[Episode], cache: Path
) -> dict[str, list[LabeledObject]]:
    # Only now: most calls need neither a client nor a renderer.
    from ...instruction_gen.llm.client import Client, openai_backend
    from ...instruction_gen.llm.settings import settings_from
    from ...instruction_gen.llm.sight import Sights
    from ..jobs.name_things import named_objects

    settings = settings_from(max_tokens=options.max_tokens, max_cost=options.max_cost)
    client = Client(settings, cache, openai_backend(settings, form=Sights))
    robot = get_robot("aliengo" if options.robot == "none" else options.robot)
    found = named_objects(episodes, options.scenes, robot, client)
    if not options.json:
        for scene, things in found.items():
            sys.stdout.write(f"{scene}: {len(things)} things named by {settings.model}\n")
    return found
