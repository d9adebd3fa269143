"""`vlnpe instruct`: texts for the paths of one episode file."""

from __future__ import annotations

import sys

from ...formats.vlnce.files import read_episodes, write_episodes
from ...formats.vlnce.groups import group_by_path, per_instruction
from ...instruction_gen.instruct import instruct_episodes
from ...instruction_gen.llm.settings import settings_from
from ...instruction_gen.records import (
    LLM,
    LOCAL,
    InstructConfig,
    parse_languages,
    parse_styles,
)
from ...instruction_gen.show import show_path
from ..jobs import instruct
from ..jobs.visibility import looked
from ..options.collect import Collect
from ..options.instructions import Instruct
from ..summary import tell


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
    made = told.episodes
    if options.per_instruction:
        made = [one for path in group_by_path(made) for one in per_instruction(path)]
    write_episodes(options.out, made)
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


def instruct_config(options: Collect | Instruct) -> InstructConfig:
    """How `collect` and `instruct` are asked to write.

    Raises:
        InputError: an unknown name or a bad number; the message lists the valid ones.
    """
    asked = None
    if options.writer in (LLM, LOCAL):
        asked = settings_from(
            local=options.writer == LOCAL,
            max_tokens=options.max_tokens,
            max_cost=options.max_cost,
        )
    return InstructConfig(
        writer=options.writer,
        styles=parse_styles(options.style),
        count=options.count,
        languages=parse_languages(options.language),
        replace=options.replace,
        llm=asked,
    )
