"""`vlnpe ablate`: train a compact agent on each mixture of a recipe and compare the results."""

from __future__ import annotations

import base64
import json
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from ...formats.core.atomic import sweep, write_bytes, write_json
from ...formats.core.errors import InputError
from ..engine.executors import available_cores

TABLE, RESULTS, PLOT, PAGE = "table.md", "results.json", "plot.png", "index.html"


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
    json: Annotated[bool, tyro.conf.arg(name="json")] = False
    """Print one JSON object with the results as the last line."""


def run(options: Ablate) -> int:
    """Run the ablation and write its report.

    Raises:
        InputError: If the recipe, settings or data are invalid, or the extra `train` is missing.
    """
    if options.threads < 0:
        raise InputError(f"--threads {options.threads}: valid: 0 (one per core) and above")
    threads = options.threads or available_cores()
    # Set before importing torch, which reads it only once.
    os.environ.setdefault("OMP_NUM_THREADS", str(threads))
    from ...datasets.mixture.recipe import read_recipe
    from ...datasets.mixture.shipped import recipe_path

    try:
        import torch
    except ImportError as error:
        raise InputError("torch is not installed; run: uv sync --inexact --extra train") from error
    from ...datasets.ablation.page import report_html
    from ...datasets.ablation.plot import plot_png
    from ...datasets.ablation.report import estimates, report_json, report_markdown
    from ...datasets.ablation.run import run_ablation

    recipe = read_recipe(recipe_path(options.recipe))
    changes: dict[str, Any] = {
        name: value
        for name in ("steps", "seeds", "device")
        if (value := getattr(options, name)) is not None
    }
    torch.set_num_threads(threads)
    if options.out.is_dir():
        sweep(options.out)
    ablation = run_ablation(recipe, options.data, options.out, changes)
    picture = plot_png(estimates(ablation), recipe.title)
    markdown = report_markdown(ablation, PLOT)
    value = report_json(ablation)
    out = options.out
    write_bytes(out / PLOT, picture)
    write_bytes(out / TABLE, markdown.encode())
    write_json(out / RESULTS, value)
    page = report_html(markdown, base64.b64encode(picture).decode())
    write_bytes(out / PAGE, page.encode())
    sys.stdout.write(f"{markdown}\n{out / PAGE}\n")
    if options.json:
        sys.stdout.write(json.dumps({"report": str(out / PAGE), **value}) + "\n")
    return 0
