"""The plan of an ablation: its trainings and episodes, checked before anything is trained."""

import logging
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...collectors.replay.suits import check_suits
from ...collectors.robots import get_robot
from ...datasets.mixture.choice import Library, NoEpisodesError, choose_all
from ...datasets.mixture.comparison import Comparison, Row
from ...datasets.mixture.recipe import NO_HOLDOUT, Recipe
from ...datasets.selection import Selection
from ...evaluation.policies.registry import resolve_policy
from ...evaluation.rounds import spread
from ...formats.core.episode import Episode
from ...formats.core.errors import InputError, check_name
from ...formats.lerobot.splits import is_published_holdout
from ...learning.config import train_config
from ...learning.training.holdout import Holdout, hold_out, published_holdout, scene_of
from ...learning.training.plan import Planned, Request, plan_training
from ..collect.evaluation import chosen_test
from ..inputs.episode_file import episodes_of
from ..options.evaluate import Evaluate
from ..options.training import Ablate

log = logging.getLogger(__name__)

CACHE = "cache"  # folder of decoded images, which all trainings share


@dataclass(frozen=True)
class Training:
    """A row's training, without seed and folder, and its data."""

    request: Request
    planned: Planned


@dataclass(frozen=True)
class Ablation:
    """A comparison whose data, settings and names have been checked.

    Attributes:
        trainings: by row.
        missing: why other rows cannot be measured, by row.
        holdout: what no row is trained on.
        episodes: what every policy walks.
        seeds: of the trainings, and of policies that draw.
    """

    recipe: Recipe
    comparison: Comparison
    trainings: Mapping[str, Training]
    missing: Mapping[str, str]
    holdout: Holdout
    episodes: tuple[Episode, ...]
    scenes: Path
    seeds: tuple[int, ...]


def plan_ablation(options: Ablate, recipe: Recipe, recipe_sha256: str) -> Ablation:
    """Choose the data of every row and the held-out episodes, which all robots can walk."""
    comparison = _comparison(options, recipe)
    settings = {
        name: value for name in ("seeds", "device") if (value := getattr(options, name)) is not None
    }
    library = Library(options.data)
    rows = {name: row for name, row in comparison.rows.items() if row.mixture}
    mixtures = {row.mixture for row in rows.values()}
    sources = dict.fromkeys(s for name in mixtures for s in recipe.mixtures[name].weights)
    selections, errors = _selections(recipe, sources, library)
    paths = [path for selection in selections.values() for path in selection.trajectories()]
    holdout = Holdout(NO_HOLDOUT, (), frozenset())
    if paths:
        holdout = hold_out(recipe, paths, published_holdout(selections.values()))
    trainings, missing = {}, {}
    for name, row in rows.items():
        lacking = [errors[s] for s in recipe.mixtures[row.mixture].weights if s in errors]
        if lacking:
            missing[name] = str(lacking[0])
            continue
        changes = _changes(recipe, row, options.steps) | settings
        request = Request(
            recipe=recipe,
            data=options.data,
            out=options.out,
            mixture=row.mixture,
            changes=changes,
            cache=options.out / CACHE,
            recipe_sha256=recipe_sha256,
            holdout=holdout,
        )
        trainings[name] = Training(request, plan_training(request))
    if rows and not trainings:
        choose_all(recipe, sources, library)  # raises, and names all that is missing
    for name, why in missing.items():
        log.warning("row %r is not measured: %s", name, why)
    episodes, scenes = _held_out_episodes(options, holdout, trainings.values())
    walked = spread(episodes, comparison.walks)
    for robot in dict.fromkeys(test.robot for test in comparison.tests.values()):
        check_suits(get_robot(robot), walked)
    seeds = train_config({**recipe.train, **settings}).seeds
    return Ablation(
        recipe,
        comparison,
        trainings,
        missing,
        holdout,
        walked,
        scenes,
        tuple(range(recipe.seed, recipe.seed + seeds)),
    )


def evaluation(comparison: Comparison, test: str, policy: str, **more: Any) -> Evaluate:
    """Return the options of `vlnpe evaluate` for a policy in a test of the comparison."""
    setting = comparison.tests[test]
    return Evaluate(
        episodes=more.pop("episodes", Path()),
        policy=policy,
        robot=setting.robot,
        controller=setting.controller,
        light=setting.light,
        camera_height=setting.camera_height_m,
        camera_pitch=setting.camera_pitch_deg,
        **more,
    )


def _comparison(options: Ablate, recipe: Recipe) -> Comparison:
    """Return the recipe's comparison with the rows and the number of walks of the options."""
    comparison = recipe.comparison
    if comparison is None:
        raise InputError(
            "the recipe has no `comparison`, which names the tests and claims "
            "(docs/guides/training.md)"
        )
    names = options.chosen_rows
    for name in names:
        check_name("row", name, comparison.rows)
    if names:
        comparison = replace(
            comparison,
            rows={name: row for name, row in comparison.rows.items() if name in names},
            claims=tuple(
                claim
                for claim in comparison.claims
                if all({row for row, _ in pair} <= set(names) for pair in comparison.pairs(claim))
            ),
        )
    if options.walks is not None:
        comparison = replace(comparison, walks=options.walks)
    for test in comparison.tests:
        chosen_test(evaluation(comparison, test, "stop"), None)
    for row in comparison.rows.values():
        if row.policy:
            resolve_policy(row.policy)
    return comparison


def _selections(
    recipe: Recipe, sources: Collection[str], library: Library
) -> tuple[dict[str, Selection], dict[str, NoEpisodesError]]:
    """Return the episodes of every source that has some, and the errors of the others."""
    selections, errors = {}, {}
    for name in sources:
        try:
            # Twice, because what is left for training decides whether a row can be measured.
            choose_all(recipe, [name], library, training=True)
            selections[name] = choose_all(recipe, [name], library)[name][0]
        except NoEpisodesError as error:
            errors[name] = error
    return selections, errors


def _changes(recipe: Recipe, row: Row, steps: int | None) -> dict[str, Any]:
    """Return a row's settings; with other `steps` than the recipe's, its own keep their ratio."""
    changes = row.changes(recipe.train)
    if steps is not None:
        usual = train_config(recipe.train).steps
        changes["steps"] = max(round(changes.get("steps", usual) * steps / usual), 1)
    return changes


def _held_out_episodes(
    options: Ablate, holdout: Holdout, trainings: Collection[Training]
) -> tuple[list[Episode], Path]:
    """Return the episodes of a run that no row is trained on, and the folder of their scenes.

    An episode is held out if its path is, if its split is, or if nobody trains in its scene.
    """
    seen = {
        path
        for training in trainings
        for source in training.planned.plan.sources
        for path in source.selection.trajectories()
    }
    scenes_seen = {scene_of(path) for path in seen}
    run = options.run or _only_run(options.data)
    episodes, scenes = episodes_of(run, None, options.split)

    def is_held_out(episode: Episode) -> bool:
        path = f"{episode.scene_id}/{episode.trajectory_id}"
        apart = path in holdout.trajectories or is_published_holdout(episode.split)
        return path not in seen and (apart or episode.scene_id not in scenes_seen)

    held = [episode for episode in episodes if is_held_out(episode)]
    if not held:
        raise InputError(
            f"{run}: none of its {len(episodes)} episodes is held out of the training; valid: "
            "another --run, or one collected with `--splits train=N,val_unseen=M`"
        )
    return held, scenes


def _only_run(data: Path) -> Path:
    """Return the only run folder under `data`, which may be one itself."""
    folders = [data, *sorted(path for path in data.iterdir() if path.is_dir())]
    runs = [f for f in folders if (f / "episodes").is_dir() and (f / "scenes").is_dir()]
    if len(runs) != 1:
        names = ", ".join(str(run) for run in runs) or "no run in it"
        raise InputError(
            f"{data}: name the run whose held-out episodes are walked with --run: {names}"
        )
    return runs[0]
