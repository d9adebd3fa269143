"""`vlnpe mix`: show the training data that each mixture of a recipe selects."""

import sys
from typing import Any

from ....datasets.mixture.choice import Library, choose_all
from ....datasets.mixture.plan import MixturePlan, plan_chosen
from ....datasets.mixture.recipe import read_recipe
from ....datasets.mixture.shipped import recipe_path
from ....datasets.mixture.table import plan_json, plan_text
from ....formats.core.atomic import write_json
from ....formats.core.errors import InputError, check_name
from ...options.training import Mix
from ...summary import print_result
from .missing import commands_for_missing


def run(options: Mix) -> int:
    """Plan the mixtures and print them."""
    check_name("draws", options.draws, ("episodes", "frames"))
    if not options.dry_run and options.out is None:
        raise InputError("vlnpe mix: pass --dry-run, or an output file with --out FILE.json")
    recipe = read_recipe(recipe_path(options.recipe))
    if options.mixture is not None:
        check_name("mixture", options.mixture, recipe.mixtures)
    names = [options.mixture] if options.mixture else list(recipe.mixtures)
    sources = dict.fromkeys(s for name in names for s in recipe.mixtures[name].weights)
    with commands_for_missing(options.data):
        chosen = choose_all(recipe, sources, Library(options.data), training=True)
    plans = [plan_chosen(recipe, name, chosen, options.draws) for name in names]
    for plan in plans:
        sys.stdout.write(f"{plan.name}: draws are {plan.unit}\n{plan_text(plan)}\n\n")
    value: dict[str, Any] = {"recipe": recipe.title, "mixtures": [plan_json(p) for p in plans]}
    if not options.dry_run and options.out is not None:
        chosen = {plan.name: _episodes(plan) for plan in plans}
        write_json(options.out, value | {"episodes": chosen})
        sys.stdout.write(f"{options.out}\n")
    if options.json:
        print_result(options, value, "")
    return 0


def _episodes(plan: MixturePlan) -> dict[str, dict[str, list[int]]]:
    """Return the episode indices by source and dataset folder."""
    result: dict[str, dict[str, list[int]]] = {}
    for source in plan.sources:
        chosen = source.selection
        result[source.name] = {
            str(index.root): [
                index.table["episode_index"][int(row)].as_py()
                for row in chosen.row[chosen.dataset == number]
            ]
            for number, index in enumerate(chosen.datasets)
        }
    return result
