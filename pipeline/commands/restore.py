"""`vlnpe restore`: give a dataset that LeRobot's tools edited vlnpe's columns back."""

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
    """Give a dataset that LeRobot deleted, split or merged what LeRobot dropped.

    Episodes are recognised by their frame rows; they get their columns in meta/episodes (uid,
    scene, split, instructions, metrics, camera, …), the dataset its provenance, splits and card.
    """

    dataset: tyro.conf.Positional[Path]
    """The edited dataset's folder; changed in place."""
    original: tuple[Path, ...]
    """The datasets that it was made from, as vlnpe wrote them."""
    json: Annotated[bool, tyro.conf.arg(name="json")] = False
    """Print one JSON object with the summary as the last line."""


def run(options: Restore) -> int:
    """Restore a dataset in place.

    Raises:
        FileFormatError: one of the folders is no dataset, or an episode is in no original.
    """
    done = restore(options.dataset, options.original)
    if options.json:
        value = {"episodes": done.episodes, "sources": [str(path) for path in done.sources]}
        sys.stdout.write(json.dumps(value) + "\n")
    else:
        sys.stdout.write(f"{options.dataset}: {done.episodes} episodes are whole again\n")
    return 0
