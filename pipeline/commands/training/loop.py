"""Closed loop during a training: validation, augmentation, and DAgger."""

import logging
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ....collectors.controllers import controller_for
from ....collectors.replay.replay import ReplayConfig
from ....evaluation.policies.learned import LearnedPolicy
from ....evaluation.policies.names import ORACLE
from ....evaluation.rounds import Round, spread
from ....formats.core.errors import InputError
from ....formats.core.rollout import EndReason
from ....learning.card import Card, View, read_card
from ....learning.checkpoint import Checkpoint
from ....learning.models.registry import Model
from ....learning.training.curves import Validation
from ....learning.training.plan import Planned, Request
from ....learning.training.session import Result, train_recipe
from ....rendering.camera.views import CameraOverrides
from ...collect.evaluation import Trial, chosen_trial
from ...collect.walked_dataset import walked_dataset
from ...context import open_context
from ...inputs.crews import chosen_robots
from ...inputs.episode_file import episodes_of
from ...inputs.views import chosen_views
from ...options.evaluate import Evaluate
from ...options.running import Running
from ...options.training import Train
from .augment import EPISODES, more_episodes

logger = logging.getLogger(__name__)


def _run_of(options: Train) -> Path:
    assert options.run is not None  # as `Train.check` demands
    return options.run


def validation(options: Train) -> Validation | None:
    """Return what scores a model in closed loop; SR counts stops within 3 m, as in `evaluate`."""
    if not options.validate:
        return None

    def validate(model: Model, card: Card) -> dict[str, float]:
        policy = LearnedPolicy(Checkpoint(card, model, ""))
        (robot,) = chosen_robots(options.robot)
        controller_for(robot, options.controller)
        light = _light(card.lights)
        (view,) = chosen_views(card.view.camera, light, "auto", robot, CameraOverrides())
        config = ReplayConfig(robot=options.robot, controller=options.controller)
        episodes, scenes = episodes_of(_run_of(options), None, options.validate_split)
        walks = Round(spread(episodes, options.validate), scenes, view, config)
        metrics = [rollout.metrics for rollout in walks.walk(policy)]
        return {
            "SR": 100 * sum(m.success for m in metrics) / len(metrics),
            "OS": 100 * sum(m.oracle_success for m in metrics) / len(metrics),
            "NE": sum(m.navigation_error_m for m in metrics) / len(metrics),
        }

    return validate


def augmentation(options: Train, planned: Planned, seed: int) -> tuple[Path, ...]:
    """Let the expert walk more paths in the training scenes (as EnvDrop's; Tan et al., 2019).

    Paths are near none that is held out. Walks that do not end at the goal are not trained on.

    Returns:
        The dataset, in <out>/augmented; walks that are there already are not made again.
    """
    folder = options.out / "augmented"
    episodes, scenes = more_episodes(options, _run_of(options), planned, seed, folder)
    walks = _evaluation(
        options, planned.view, planned.every("light"), policy=ORACLE, episodes=folder / EPISODES,
        scenes=scenes,
    )  # fmt: skip
    dataset, ends = walked(chosen_trial(walks), walks, folder / "walks", options.threads)
    arrived = ends[str(EndReason.SUCCESS)]
    if not arrived:
        raise InputError(
            f"--augment: none of the expert's {len(episodes)} walks ended at its goal; valid: "
            "another --robot or --controller, or no --augment"
        )
    if arrived < len(episodes):
        logger.warning(
            "--augment: %d of %d walks did not end at their goal and are left out",
            len(episodes) - arrived, len(episodes),
        )  # fmt: skip
    return (dataset,)


def dagger(options: Train, request: Request, result: Result) -> Result:
    """Let each model walk, and go on training with the expert's labels of all rounds.

    An interrupted round is taken up where it stopped.
    """
    datasets: list[Path] = []
    for number in range(1, options.dagger + 1):
        folder = options.out / f"dagger-{number}"
        card, _ = read_card(result.checkpoint)
        walks = _evaluation(
            options, card.view, card.lights, policy=str(result.checkpoint),
            episodes=_run_of(options),
        )  # fmt: skip
        trial = chosen_trial(walks)
        held_out = frozenset(card.held_out["trajectories"])
        free = [e for e in trial.episodes if f"{e.scene_id}/{e.trajectory_id}" not in held_out]
        trial = replace(trial, episodes=spread(free, options.dagger_episodes))
        # The expert's share halves from round to round, as in VLN-CE.
        dataset, ends = walked(trial, walks, folder / "walks", options.threads, beta=0.5**number)
        if not ends:
            raise InputError(
                f"--dagger: none of {len(trial.episodes)} episodes could be walked; "
                f"{folder / 'walks'} says why"
            )
        datasets.append(dataset)
        request = replace(
            request,
            out=folder,
            start=result.checkpoint,
            dagger=tuple(datasets),
            cache=options.cache or options.out / "cache",
        )
        result = train_recipe(request)
    return result


def _evaluation(options: Train, seen: View, lights: Sequence[str], **named: Any) -> Evaluate:
    """Return the options of walks with the robot of a training and the camera of its data."""
    shared = {"robot": options.robot, "controller": options.controller, "camera": seen.camera}
    return Evaluate(**shared, light=_light(lights), **named)


def _light(lights: Sequence[str]) -> str:
    return lights[0] if len(lights) == 1 else Evaluate.light


def walked(
    trial: Trial, walks: Evaluate, out: Path, workers: int, *, beta: float | None = None
) -> tuple[Path, Counter[str]]:
    """Return the dataset of walks, and how many ended for which reason."""
    with open_context(out, Running(workers=workers)) as context:
        made = walked_dataset(context, trial, walks, beta=beta, mcap=False)
    if lost := sum(stage.quarantined for stage in made.stages):
        logger.warning("%s: %d items failed and are left out (quarantine.json)", out, lost)
    frames = made.stages[1].good().values()
    return made.dataset, Counter(str(row.facts["end_reason"]) for row in frames)
