"""`vlnpe ablate`: train a compact agent on each mixture of a recipe and compare the results."""

import json
import sys
from typing import Any

from ....formats.core.atomic import sweep, write_bytes, write_json
from ...options.training import Ablate
from .missing import commands_for_missing
from .threads import start_torch

TABLE, RESULTS, PLOT, PAGE = "table.md", "results.json", "plot.png", "index.html"


def run(options: Ablate) -> int:
    """Run the ablation and write its report.

    Raises:
        InputError: If the recipe, settings or data are invalid, or the extra `train` is missing.
    """
    start_torch(options.threads)
    from ....datasets.mixture.recipe import read_recipe
    from ....datasets.mixture.shipped import recipe_path
    from ....learning.ablation.page import plot_png, report_html
    from ....learning.ablation.report import estimates, report_json, report_markdown
    from ....learning.ablation.run import run_ablation

    recipe = read_recipe(recipe_path(options.recipe))
    changes: dict[str, Any] = {
        name: value
        for name in ("steps", "seeds", "device")
        if (value := getattr(options, name)) is not None
    }
    if options.out.is_dir():
        sweep(options.out)
    with commands_for_missing(options.data):
        ablation = run_ablation(recipe, options.data, options.out, changes)
    picture = plot_png(estimates(ablation), recipe.title)
    markdown = report_markdown(ablation, PLOT)
    value = report_json(ablation)
    out = options.out
    write_bytes(out / PLOT, picture)
    write_bytes(out / TABLE, markdown.encode())
    write_json(out / RESULTS, value)
    page = report_html(markdown, PLOT, picture)
    write_bytes(out / PAGE, page.encode())
    sys.stdout.write(f"{markdown}\n{out / PAGE}\n")
    if options.json:
        sys.stdout.write(json.dumps({"report": str(out / PAGE), **value}) + "\n")
    return 0
