"""`vlnpe train`: train a policy on a mixture of a recipe."""

from dataclasses import replace
from typing import Any

from ....formats.core.atomic import file_digest, sweep
from ....formats.core.checkout import program
from ....formats.core.errors import InputError
from ...options.training import Train
from ...summary import print_result
from .missing import commands_for_missing
from .threads import start_torch

RDP = "rdp"
_NO_WALKS = (
    f"{{flag}}: {RDP} predicts waypoints, and the expert's walks have discrete actions; valid: "
    "--model cma or seq2seq, or no {flag}"
)


def run(options: Train) -> int:
    """Train, and print where the checkpoint is and how to evaluate it."""
    start_torch(options.threads)
    from ....datasets.mixture.recipe import read_recipe
    from ....datasets.mixture.shipped import recipe_path
    from ....learning.training.curves import CURVES
    from ....learning.training.plan import Request, plan_training
    from ....learning.training.session import train_recipe
    from .loop import augmentation, dagger, validation

    path = recipe_path(options.recipe)
    recipe = read_recipe(path)
    for flag, count in (("--augment", options.augment), ("--dagger", options.dagger)):
        if count and options.changes(recipe.train)["model"].get("name") == RDP:
            raise InputError(_NO_WALKS.format(flag=flag))
    if options.out.is_dir():
        sweep(options.out)
    request = Request(
        recipe=recipe,
        data=options.data,
        out=options.out,
        mixture=options.mixture,
        seed=options.seed,
        changes=options.changes(recipe.train),
        start=options.start,
        validate=validation(options),
        cache=options.cache,
        recipe_sha256=file_digest(path),
    )
    with commands_for_missing(options.data):
        if options.augment:
            seed = recipe.seed if options.seed is None else options.seed
            walks = augmentation(options, plan_training(request), seed)
            request = replace(request, augmented=walks)
        result = dagger(options, request, train_recipe(request))
    last = dict(result.curves[-1]) if result.curves else {}
    lines = [
        "",
        *_described(last),
        f"\ncheckpoint: {result.checkpoint} (step {result.chosen})",
        f"curves:     {options.out / CURVES}",
        f"evaluate:   {program()} evaluate <run> --policy {result.checkpoint} --robot <robot>",
    ]
    facts = {"checkpoint": str(result.checkpoint), "step": result.chosen, "last": last}
    return print_result(options, facts, "\n".join(lines))


def _described(last: dict[str, Any]) -> list[str]:
    """Return the last scores in words."""
    lines = []
    for where, name in (("train", "training"), ("held", "held-out")):
        if f"{where} action" in last:
            action, constant = last[f"{where} action"], last[f"{where} constant"]
            lines.append(
                f"{name} steps: {100 * action:.1f} % of the actions right (the commonest action: "
                f"{100 * constant:.1f} %), {100 * last[f'{where} stop']:.0f} % of the stops"
            )
        elif f"{where} loss" in last:
            lines.append(f"{name} loss: {last[f'{where} loss']:.3f}")
    if "SR" in last:
        lines.append(f"closed loop: SR {last['SR']:.1f} %")
    return lines
