"""`vlnpe restore`: restore vlnpe's columns in a dataset edited with LeRobot's tools."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ...formats.convert.restore import restore


@dataclass(frozen=True)
class Restore:
    """Restore the metadata that LeRobot's delete, split and merge tools drop from a dataset.

    Episodes are matched by their frame rows. Restores the columns in meta/episodes (uid, scene,
    split, instructions, metrics, camera, …) and the provenance, splits and card of the dataset.
    """

    dataset: tyro.conf.Positional[Path]
    """Folder of the edited dataset; modified in place."""
    original: tuple[Path, ...]
    """Datasets that it was made from, as written by vlnpe."""
    json: Annotated[bool, tyro.conf.arg(name="json")] = False
    """Print one JSON object with the summary as the last line."""


def run(options: Restore) -> int:
    """Restore a dataset in place.

    Raises:
        FileFormatError: If a folder is not a dataset, or an episode is in none of the originals.
    """
    done = restore(options.dataset, options.original)
    if options.json:
        value = {"episodes": done.episodes, "sources": [str(path) for path in done.sources]}
        sys.stdout.write(json.dumps(value) + "\n")
    else:
        sys.stdout.write(f"{options.dataset}: {done.episodes} episodes restored\n")
    return 0
