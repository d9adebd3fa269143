"""Commands that collect missing training data, and the run whose episodes are walked."""

import shlex
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain, pairwise
from pathlib import Path

from ....datasets.mixture.choice import NoEpisodesError
from ....datasets.mixture.recipe import EVERYTHING, OWN_VIEW, Source
from ....formats.core.checkout import program
from ....formats.core.rollout import HUMAN
from ...engine.ledger import MANIFEST_NAME, Ledger
from ...options.collect import Collect

COLLECT = "collect"
NEW_RUN = "apartment-0"  # of the built-in scene
NEW_PATHS = 24  # as in the comments of the built-in recipes


@contextmanager
def commands_for_missing(data: Path) -> Iterator[None]:
    """Add to a `NoEpisodesError` the commands that collect what is missing under `data`."""
    try:
        yield
    except NoEpisodesError as error:
        # Robots that need the same controllers and views are collected together.
        alike: dict[Source, dict[str, Source]] = {}
        for name, source in error.lacking.items():
            if source.data == EVERYTHING and not (
                source.splits or source.scenes or HUMAN in source.controllers
            ):
                others = replace(source, robots=(), outcomes=(), fraction=1.0)
                alike.setdefault(others, {})[name] = source
        error.hints = tuple(
            f"{collect_command(_joined(named.values()), data)}  # {', '.join(named)}"
            for named in alike.values()
        )
        raise


def _joined(sources: Iterable[Source]) -> Source:
    """Return a source of all robots of some that are alike in what else is collected."""
    first, *others = sources
    robots = dict.fromkeys(robot for source in (first, *others) for robot in source.robots)
    return replace(first, robots=tuple(robots))


def collect_command(source: Source, data: Path) -> str:
    """Return the command that collects a source's robots, controllers, lights and cameras.

    They join the run under `data` that has the most paths, on all of them; without a run, a new one
    is made there.
    """
    options = {
        "--robot": source.robots,
        "--controller": source.controllers,
        "--light": source.lights,
        "--camera": () if source.cameras == (OWN_VIEW,) else source.cameras,
    }
    requested = {option: ",".join(names) for option, names in options.items() if names}
    runs = [run for run in (data, *sorted(data.glob("*"))) if (run / MANIFEST_NAME).is_file()]
    ledgers = [ledger for ledger in map(Ledger, runs) if f" {COLLECT} " in f"{ledger.finished} "]
    if not ledgers:
        requested |= {"--episodes": str(NEW_PATHS), "--out": str(data / NEW_RUN)}
        return f"{program()} {COLLECT} {shlex.join(chain(*requested.items()))}"
    ledger = max(ledgers, key=lambda candidate: sum(_paths(candidate).values()))
    command, _, rest = f"{ledger.finished} ".partition(f" {COLLECT} ")
    words = shlex.split(rest)
    # The last command may have asked for fewer paths than the robots before had walked.
    given = dict(pairwise(words)).get("--episodes", "" if "--splits" in words else Collect.episodes)
    walked = max(_paths(ledger).values(), default=0)
    if given.isdecimal() and int(given) < walked:
        requested["--episodes"] = str(walked)
    remaining = [
        word
        for word, previous in zip(words, ["", *words], strict=False)
        if word not in requested and previous not in requested
    ]
    return f"{command} {COLLECT} {shlex.join([*remaining, *chain(*requested.items())])}"


def _paths(ledger: Ledger) -> dict[str, int]:
    """Return on how many paths a run's robots have walked, by scene."""
    by_scene: dict[str, set[str]] = {}
    for row in ledger.done("replay"):
        by_scene.setdefault(row.facts.get("scene", ""), set()).add(row.item.rpartition("/")[2])
    return {scene: len(paths) for scene, paths in by_scene.items()}
