"""Give every episode of a file an instruction."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from ..formats.core.episode import Episode
from ..formats.core.errors import InputError, UnknownNameError
from ..formats.scene.bundle import SceneBundle, load_bundle
from ..formats.vlnce.files import scene_stem
from ..wayfinding.regions import RegionMap, region_map
from .check import check_instruction
from .compose import OFFLINE, compose_instruction
from .records import InstructConfig, Instruction

logger = logging.getLogger(__name__)

Composer = Callable[[Episode, SceneBundle, np.random.Generator, str, RegionMap], Instruction]

COMPOSERS: dict[str, Composer] = {OFFLINE: compose_instruction}


@dataclass(frozen=True)
class InstructResult:
    """Episodes with instructions.

    Attributes:
        episodes: in the order given.
        problems: what the checks still find, by episode id; only episodes with problems.
    """

    episodes: list[Episode]
    problems: dict[str, list[str]] = field(default_factory=dict)


def instruct_episodes(
    episodes: Sequence[Episode],
    scenes: Path,
    config: InstructConfig,
    rng: np.random.Generator,
) -> InstructResult:
    """Write an instruction for each episode that has none.

    A text that fails its checks, or that another trajectory of this call already has, is
    composed anew; the attempt with the fewest problems is kept and what remains is reported.
    Facts about the text go to the episode's `extra["instruction"]`.

    Args:
        episodes: any number, of any scenes.
        scenes: folder of repaired scenes, one folder each.
        config: how.
        rng: chooses among phrasings.

    Raises:
        UnknownNameError: no such composer.
        FileFormatError: a scene is missing.
    """
    if config.composer not in COMPOSERS:
        raise UnknownNameError("instruction composer", config.composer, COMPOSERS)
    compose = COMPOSERS[config.composer]
    bundles: dict[str, SceneBundle] = {}
    regions: dict[tuple[str, int], RegionMap] = {}
    result = InstructResult([])
    taken: dict[str, str] = {}
    for episode in episodes:
        if episode.instruction and not config.replace:
            result.episodes.append(episode)
            continue
        scene = scene_stem(episode.scene_id)
        if scene not in bundles:
            bundles[scene] = load_bundle(scenes / scene)
        bundle = bundles[scene]
        if not 0 <= episode.level < len(bundle.level_floor_z_m):
            raise InputError(
                f"episode {episode.episode_id} is on level {episode.level} of {scene}; "
                f"valid: 0 … {len(bundle.level_floor_z_m) - 1}"
            )
        if (scene, episode.level) not in regions:
            regions[scene, episode.level] = region_map(bundle, episode.level)
        rooms = regions[scene, episode.level]
        tries: list[tuple[list[str], Instruction]] = []
        for _ in range(config.attempts):
            style = config.style
            if style == "mixed":
                style = "detailed" if rng.random() < 0.6 else "concise"
            instruction = compose(episode, bundle, rng, style, rooms)
            problems = check_instruction(instruction, episode, bundle, rooms)
            if taken.get(instruction.text, episode.trajectory_id) != episode.trajectory_id:
                problems.append("another trajectory has the same instruction")
            tries.append((problems, instruction))
            if not problems:
                break
        problems, instruction = min(tries, key=lambda t: len(t[0]))
        taken[instruction.text] = episode.trajectory_id
        if problems:
            result.problems[episode.episode_id] = problems
            logger.warning("episode %s: %s", episode.episode_id, "; ".join(problems))
        facts = asdict(instruction)
        del facts["text"]
        facts = {k: list(v) if isinstance(v, tuple) else v for k, v in facts.items()}
        result.episodes.append(
            replace(
                episode,
                instruction=instruction.text,
                extra={**episode.extra, "instruction": facts},
            )
        )
    return result
