"""Write checked instructions for every path of a file."""

import hashlib
import logging
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from itertools import batched
from pathlib import Path
from typing import Any

import numpy as np

from ..formats.core.episode import Episode
from ..formats.core.errors import InputError
from ..formats.scene.bundle import load_bundle
from ..formats.scene.visibility import Visibility
from ..formats.vlnce.files import scene_stem
from .checker import Ground
from .checker.order import step_starts_m
from .composer import Usage, compose_texts
from .facts import LevelFacts, path_facts
from .facts.named import Named
from .facts.records import PathFacts
from .llm.brief import prompts_sha256
from .llm.settings import CACHE_NAME
from .records import COMPOSER, LOCAL, InstructConfig, WrittenText
from .rivals import Rivals

logger = logging.getLogger(__name__)

# A path's texts, or problems where none is true.
Written = tuple[list[WrittenText], list[str]]
Writer = Callable[[Ground, np.random.Generator, Rivals], Written]


@dataclass(frozen=True)
class InstructResult:
    """Episodes with instructions.

    Attributes:
        episodes: in the order given, without those in `failed`.
        failed: why a path has no instruction, by episode id.
        unnamed: labels of the scenes that no noun is known for, with how often they occur.
        model: the client of a language model, if one was asked.
    """

    episodes: list[Episode]
    failed: dict[str, str] = field(default_factory=dict)
    unnamed: dict[str, int] = field(default_factory=dict)
    model: list[Any] = field(default_factory=list)

    @property
    def unchecked(self) -> int:
        """How many texts have words that no claim covers."""
        return self._with("unchecked")

    @property
    def ambiguous(self) -> int:
        """How many texts may lead elsewhere, too, as nothing on their levels has a name."""
        return self._with("leads_elsewhere")

    def _with(self, key: str) -> int:
        records = (e.extra.get("instruction") or {} for e in self.episodes)
        return sum(bool(t.get(key)) for made in records for t in made.get("texts", ()))

    def usage(self) -> dict[str, Any]:
        """Return requests, tokens and cost of the language model so far; empty without one."""
        return asdict(self.model[0].budget.used()) if self.model else {}


class Levels:
    """Levels of repaired scenes, opened when they are asked for."""

    def __init__(self, scenes: Path, named: Mapping[str, Named] | None = None):
        """Remember the folder of repaired scenes, one folder each, and what is named in them."""
        self._scenes, self._named = scenes, named or {}
        self._open: dict[tuple[str, int], LevelFacts] = {}

    def facts(self, episode: Episode, visibility: Visibility | None = None) -> PathFacts:
        """Return the facts of an episode's path; `visibility` as for `path_facts`.

        Raises:
            FileFormatError: its scene is missing.
            InputError: the scene has no such level or staircase.
        """
        first, *beyond = (self.of(episode, level) for level in episode.levels)
        return path_facts(episode, first, visibility, beyond)

    def rivals(self, episode: Episode, facts: PathFacts) -> Rivals:
        """Return the other ways from where an episode's path with these facts starts.

        Raises:
            FileFormatError: its scene is missing.
            InputError: the scene has no such level.
        """
        return Rivals(episode, [self.of(episode, level) for level in episode.levels], facts)

    def of(self, episode: Episode, level: int | None = None) -> LevelFacts:
        """Return a level of an episode's scene, by default the one that it starts on.

        Raises:
            FileFormatError: its scene is missing.
            InputError: the scene has no such level.
        """
        scene = scene_stem(episode.scene_id)
        level = episode.level if level is None else level
        key = (scene, level)
        if key not in self._open:
            bundle = load_bundle(self._scenes / scene)
            more = self._named.get(scene, Named())
            if more.objects:
                bundle = replace(bundle, objects=(*bundle.objects, *more.objects))
            if not 0 <= level < len(bundle.level_floor_z_m):
                raise InputError(
                    f"episode {episode.episode_id} is on level {level} of {scene}; "
                    f"valid: 0 … {len(bundle.level_floor_z_m) - 1}"
                )
            self._open[key] = LevelFacts.of(bundle, level, named=more.rooms)
        return self._open[key]

    def unnamed(self) -> dict[str, int]:
        """Return the labels without a noun, of all levels opened."""
        total: dict[str, int] = {}
        for level in self._open.values():
            for label, count in level.unnamed.items():
                total[label] = total.get(label, 0) + count
        return dict(sorted(total.items()))


def instruct_episodes(
    episodes: Sequence[Episode],
    scenes: Path,
    config: InstructConfig,
    seed: int,
    visibility: Visibility | None = None,
    writer: Writer | None = None,
    cache: Path = Path(CACHE_NAME),
    *,
    named: Mapping[str, Named] | None = None,
    keep: Callable[[PathFacts], None] | None = None,
) -> InstructResult:
    """Write the instructions of each path whose episodes have none.

    All texts of a path go to `extra["instructions"]`, the first is the episode's instruction, and
    how they were made goes to `extra["instruction"]`. A path for which no true text could be
    written is left out and named in `failed`.

    Args:
        episodes: any number, of any scenes; those of one trajectory share their texts.
        scenes: folder of repaired scenes, one folder each.
        seed: of the phrasing; each path's texts depend on it and on the path alone.
        visibility: what the robot's camera sees along the paths; without it, walls alone decide.
        writer: writes a path's texts; by default the one that `config` names.
        cache: folder of a language model's answers.
        named: things and rooms, by scene, where a scan has no labels.
        keep: is given the facts of each path, one after the other; none are held here.

    Raises:
        FileFormatError: a scene is missing.
        InputError: an episode lies on a level that its scene does not have.
        ModelDownError: a language model fails again and again; what it wrote is in the cache.
        BudgetError: no more may be spent on one.
    """
    levels = Levels(scenes, named)
    taken: set[str] = set()
    result = InstructResult([])
    write = writer or _writer(config, taken, cache, result)
    asked = [e for e in episodes if config.replace or not e.instruction]
    paths: dict[str, Episode] = {}
    for episode in asked:
        for level in episode.levels:  # a missing scene is told before anything is written
            levels.of(episode, level)
        paths.setdefault(f"{episode.scene_id}/{episode.trajectory_id}", episode)

    def describe(path: str, facts: PathFacts) -> Written:
        ground = Ground(facts)
        texts, problems = write(
            ground, path_generator(seed, path), levels.rivals(paths[path], facts)
        )
        texts = [  # with where the steps begin, if its words are those of the steps
            replace(t, from_m=step_starts_m(t.steps, ground)) if t.language == "en" else t
            for t in texts
        ]
        taken.update(text.text for text in texts)
        return texts, problems

    # A model's server answers several at once; the composer has nothing to wait for.
    workers = config.llm.workers if config.llm and writer is None else 1
    done: dict[str, Written] = {}
    with ThreadPoolExecutor(workers) as pool:
        for names in batched(paths, 4 * workers):
            some = [paths[name] for name in names]
            every = [levels.facts(e, visibility) for e in some]
            for facts in every:
                if keep is not None:
                    keep(facts)
            done |= zip(names, pool.map(describe, names, every), strict=True)
    for episode in episodes:
        if episode.instruction and not config.replace:
            result.episodes.append(episode)
            continue
        texts, problems = done[f"{episode.scene_id}/{episode.trajectory_id}"]
        if texts:
            result.episodes.append(with_texts(episode, texts, config))
            continue
        reason = "; ".join(problems) or "no two drafts of it differ from other paths' texts"
        result.failed[episode.episode_id] = reason
        logger.warning("episode %s has no true instruction: %s", episode.episode_id, reason)
    result.unnamed.update(levels.unnamed())
    if result.unchecked:
        logger.warning(
            "%d texts have words that no claim covers; the export leaves them out unless a person "
            "accepts them in `vlnpe review`",
            result.unchecked,
        )
    if result.ambiguous:
        logger.warning(
            "%d texts may lead elsewhere, too: nothing on their levels has a name",
            result.ambiguous,
        )
    return result


def _writer(config: InstructConfig, taken: set[str], cache: Path, result: InstructResult) -> Writer:
    if config.writer == COMPOSER:
        usage, styles = Usage(), config.styles
        return lambda ground, rng, rivals: compose_texts(
            ground, config.count, styles, rng, taken, usage, rivals
        )
    settings = config.llm
    if settings is None:
        raise InputError(f"--writer {config.writer}: no language model is configured")
    # Only now: most runs need no client.
    from .llm.client import Client, openai_backend
    from .llm.local import local_backend
    from .llm.writer import ModelWriter

    backend_of = local_backend if config.writer == LOCAL else openai_backend
    client = Client(settings, cache, backend_of(settings, texts=config.count))
    result.model.append(client)
    return ModelWriter(client, config)


def with_texts(
    episode: Episode, texts: Sequence[WrittenText], config: InstructConfig | None = None
) -> Episode:
    """Return the episode with its texts and a record of how they were made."""
    asked = config.llm if config else None
    made = {
        "composer": texts[0].writer,
        "style": texts[0].style,
        "model": Path(asked.model).name if asked else None,
        "prompt_sha256": prompts_sha256() if asked else None,
        "temperature": asked.temperature if asked else None,
        "texts": [one.record() for one in texts],
    }
    extra = {**episode.extra, "instruction": made, "instructions": [one.text for one in texts]}
    return replace(episode, instruction=texts[0].text, extra=extra)


def path_generator(seed: int, path: str) -> np.random.Generator:
    """Return the random generator of one path, which depends on no other path."""
    word = int.from_bytes(hashlib.sha256(path.encode()).digest()[:8], "big")
    return np.random.default_rng([seed, word])
