"""`vlnpe ablate`: train a policy on each mixture of a recipe, let it walk, and compare."""

from ....formats.core.atomic import file_digest
from ....formats.core.errors import InputError
from ...engine.lock import lock, sweep_unlocked
from ...options.training import Ablate
from ...summary import print_result
from .missing import commands_for_missing
from .threads import start_torch


def run(options: Ablate) -> int:
    """Run the ablation and write its report after every cell."""
    start_torch(options.threads)
    from ....datasets.mixture.recipe import read_recipe
    from ....datasets.mixture.shipped import recipe_path
    from ...ablation.cells import CellResult, measure
    from ...ablation.page import PAGE, markdown, write_page
    from ...ablation.plan import plan_ablation
    from ...ablation.results import results_json, write_results

    if options.trainings is not None and not options.trainings.is_dir():
        raise InputError(
            f"--trainings {options.trainings}: no such folder; valid: --out of an ablation"
        )
    path = recipe_path(options.recipe)
    with commands_for_missing(options.data):
        ablation = plan_ablation(options, read_recipe(path), file_digest(path))
    options.out.mkdir(parents=True, exist_ok=True)
    cells: dict[tuple[str, str, int], CellResult] = {}
    value = results_json(ablation, cells)
    with lock(options.out):
        # What others train or decode for their own walks is locked; see `train`.
        sweep_unlocked(options.out)
        for cell, result in measure(ablation, options):
            cells[cell] = result
            value = results_json(ablation, cells)
            write_results(options.out, value)
            write_page(options.out, value)
    print_result(options, value, f"{markdown(value)}\nreport: {options.out / PAGE}")
    return int(any(result.failed for result in cells.values()))
