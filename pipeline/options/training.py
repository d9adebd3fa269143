"""Options of the commands for training data: `mix`, `ablate`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from . import Json


@dataclass(frozen=True)
class Mix:
    """Show the training data of a recipe's mixtures: datasets, episodes, shares and exclusions.

    Unless --dry-run is given, the selected episodes are also written to --out, by dataset and
    episode index.
    """

    recipe: tyro.conf.Positional[str]
    """Recipe file (.yaml), or the name of a built-in recipe: cross_embodiment, controller,
    lighting."""
    data: Path = Path("runs")
    """Folder of the runs that contain the datasets."""
    mixture: str | None = None
    """Show only this mixture of the recipe."""
    draws: str = "episodes"
    """Unit that is sampled and that shares are computed from: episodes or frames."""
    dry_run: bool = False
    """Show the mixtures without writing anything."""
    out: Path | None = None
    """Output file for the selected episodes (.json)."""
    json: Json = False
    """Print one JSON object with the plan as the last line."""


@dataclass(frozen=True)
class Ablate:
    """Train a compact agent on each mixture of a recipe and evaluate it on held-out episodes.

    Writes table.md, results.json, plot.png and index.html. Run the same command again to resume
    after an interruption.
    """

    recipe: tyro.conf.Positional[str]
    """Recipe file (.yaml), or the name of a built-in recipe: cross_embodiment, controller,
    lighting."""
    data: Path = Path("runs")
    """Folder of the runs that contain the datasets."""
    out: Path = Path("runs/ablation")
    """Output folder for results, checkpoints and decoded images."""
    steps: int | None = None
    """Training steps per mixture and seed; overrides the recipe."""
    seeds: int | None = None
    """Number of seeds per mixture; overrides the recipe."""
    device: str | None = None
    """Torch device: cpu, cuda or auto; overrides the recipe."""
    threads: int = 0
    """Number of torch threads; 0 uses one per core."""
    json: Json = False
    """Print one JSON object with the results as the last line."""
