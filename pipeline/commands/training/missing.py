"""The commands that collect what a recipe finds no episodes for."""

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ....datasets.mixture.choice import NoEpisodesError
from ....datasets.mixture.recipe import EVERYTHING, OWN_VIEW, Source
from ....formats.core.checkout import program
from ...engine.ledger import MANIFEST_NAME, Ledger

COLLECT = "collect"
NEW_RUN = "apartment-0"  # of the built-in scene


@contextmanager
def commands_for_missing(data: Path) -> Iterator[None]:
    """Add to a `NoEpisodesError` the commands that collect what is missing under `data`."""
    try:
        yield
    except NoEpisodesError as error:
        error.hints = tuple(
            f"{collect_command(source, data)}  # {name}"
            for name, source in error.lacking.items()
            if source.data == EVERYTHING and not (source.splits or source.scenes)
        )
        raise


def collect_command(source: Source, data: Path) -> str:
    """Return the command that collects a source's robots, controllers, lights and cameras.

    They join the first run under `data`, on its paths; without one, a new run is made there.
    """
    options = {
        "--robot": source.robots,
        "--controller": source.controllers,
        "--light": source.lights,
        "--camera": () if source.cameras == (OWN_VIEW,) else source.cameras,
    }
    wanted = {option: ",".join(names) for option, names in options.items() if names}
    added = [word for pair in wanted.items() for word in pair]
    for run in (data, *sorted(data.glob("*"))):
        before = Ledger(run).finished if (run / MANIFEST_NAME).is_file() else ""
        command, known, rest = f"{before} ".partition(f" {COLLECT} ")
        if known:
            words = shlex.split(rest)
            kept = [
                word
                for word, previous in zip(words, ["", *words], strict=False)
                if word not in wanted and previous not in wanted
            ]
            return f"{command} {COLLECT} {shlex.join([*kept, *added])}"
    return f"{program()} {COLLECT} {shlex.join([*added, '--out', str(data / NEW_RUN)])}"
