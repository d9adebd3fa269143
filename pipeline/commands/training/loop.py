"""Closed loop during a training: validation, augmentation, and DAgger."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from ....collectors.controllers import controller_for
from ....collectors.replay.replay import ReplayConfig
from ....collectors.replay.world import World
from ....evaluation.dagger import corrected_walk
from ....evaluation.episode import closed_loop
from ....evaluation.observation import Eye
from ....evaluation.policies.learned import LearnedPolicy
from ....evaluation.rounds import Round, spread
from ....formats.core.atomic import write_bytes, write_json
from ....formats.core.episode import Episode
from ....formats.core.errors import InputError
from ....formats.core.progress import progress_bar
from ....formats.core.rollout import EndReason
from ....learning.card import Card, View
from ....learning.checkpoint import Checkpoint, load_checkpoint
from ....learning.models.registry import Model
from ....learning.training.corrections import Correction, write_correction
from ....learning.training.curves import Validation
from ....learning.training.session import Planned, Request, Result, train_recipe
from ....rendering.camera.views import CameraOverrides
from ...inputs.crews import chosen_robots
from ...inputs.episode_file import episodes_of
from ...inputs.views import chosen_views
from ...options.training import Train
from .augment import MADE_BY, check_made_by, more_episodes, walker

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Walks:
    """Episodes of a run, and how a model that is being trained walks them."""

    options: Train
    split: str | None

    def round(self, card: Card, count: int, held_out: frozenset[str] = frozenset()) -> Round:
        """Return up to `count` episodes, evenly spread, none of a trajectory that is held out."""
        episodes, scenes = episodes_of(_run_of(self.options), None, self.split)
        episodes = [e for e in episodes if f"{e.scene_id}/{e.trajectory_id}" not in held_out]
        return _round(self.options, card.view, card.lights, spread(episodes, count), scenes)


def _round(
    options: Train, seen: View, lights: Sequence[str], episodes: tuple[Episode, ...], scenes: Path
) -> Round:
    """Return episodes as the robot of the options walks them, with the camera of the data."""
    (robot,) = chosen_robots(options.robot)
    controller_for(robot, options.controller)
    light = lights[0] if len(lights) == 1 else "baked"
    (view,) = chosen_views(seen.camera, light, "auto", robot, CameraOverrides())
    config = ReplayConfig(robot=options.robot, controller=options.controller)
    return Round(episodes, scenes, view, closed_loop(config))


def _run_of(options: Train) -> Path:
    assert options.run is not None  # as `Train.check` demands
    return options.run


def validation(options: Train) -> Validation | None:
    """Return what scores a model in closed loop; SR counts stops within 3 m, as in `evaluate`."""
    if not options.validate:
        return None

    def validate(model: Model, card: Card) -> dict[str, float]:
        policy = LearnedPolicy(Checkpoint(card, model, ""))
        walks = _Walks(options, options.validate_split).round(card, options.validate)
        metrics = [walk.metrics for walk in walks.walk(policy)]
        return {
            "SR": 100 * sum(m.success for m in metrics) / len(metrics),
            "OS": 100 * sum(m.oracle_success for m in metrics) / len(metrics),
            "NE": sum(m.navigation_error_m for m in metrics) / len(metrics),
        }

    return validate


def augmentation(options: Train, planned: Planned, seed: int) -> tuple[Path, ...]:
    """Let the expert walk more paths in the training scenes (as EnvDrop's; Tan et al., 2019).

    Paths are near none that is held out. Walks that do not end at the goal are left out.

    Returns:
        Files of the walks, in <out>/augmented; those that are there already are not made again.
    """
    folder = options.out / "augmented"
    episodes, scenes = more_episodes(options, _run_of(options), planned, seed, folder)
    walks = _round(options, planned.view, planned.every("light"), tuple(episodes), scenes)
    size_px, far_m = planned.config.size_px, planned.view.depth_far_m

    def walk(_: int, world: World, eye: Eye, episode: Episode) -> Correction | None:
        rng = np.random.default_rng(0)
        end, correction = corrected_walk(
            world, episode, walks.config, None, eye,
            expert_share=1.0, rng=rng, size_px=size_px, depth_far_m=far_m,
        )  # fmt: skip
        return correction if end is EndReason.SUCCESS else None

    files = _walk_files(folder, walks, "augment", walk)
    if not files:
        raise InputError(
            f"--augment: none of the expert's {len(episodes)} walks ended at its goal; valid: "
            "another --robot or --controller, or no --augment"
        )
    if len(files) < len(episodes):
        logger.warning(
            "--augment: %d of %d walks did not end at their goal and are left out",
            len(episodes) - len(files), len(episodes),
        )  # fmt: skip
    return files


def dagger(options: Train, request: Request, result: Result) -> Result:
    """Let each model walk, and go on training with the expert's corrections of all rounds.

    An interrupted round is taken up where it stopped.
    """
    files: list[Path] = []
    for number in range(1, options.dagger + 1):
        folder = options.out / f"dagger-{number}"
        checkpoint = load_checkpoint(result.checkpoint)
        held_out = frozenset(checkpoint.card.held_out["trajectories"])
        walks = _Walks(options, None).round(checkpoint.card, options.dagger_episodes, held_out)
        # The expert's share halves from round to round, as in VLN-CE.
        files += _corrections(options, folder / "walks", walks, checkpoint, 0.5**number)
        request = replace(
            request,
            out=folder,
            start=result.checkpoint,
            corrections=tuple(files),
            cache=options.cache or options.out / "cache",
        )
        result = train_recipe(request)
    return result


def _corrections(
    options: Train, folder: Path, walks: Round, checkpoint: Checkpoint, expert_share: float
) -> tuple[Path, ...]:
    made_by = {
        **walker(options),
        "checkpoint": checkpoint.sha256,
        "expert_share": expert_share,
        "view": asdict(checkpoint.card.view),
        "lights": list(checkpoint.card.lights),
        "episodes": [f"{e.scene_id}/{e.episode_id}" for e in walks.episodes],
    }
    check_made_by(folder, made_by)
    write_json(folder / MADE_BY, made_by)

    size_px, far_m = checkpoint.card.config.size_px, checkpoint.card.view.depth_far_m

    def walk(number: int, world: World, eye: Eye, episode: Episode) -> Correction:
        policy, rng = LearnedPolicy(checkpoint), np.random.default_rng(number)
        _, correction = corrected_walk(
            world, episode, walks.config, policy, eye,
            expert_share=expert_share, rng=rng, size_px=size_px, depth_far_m=far_m,
        )  # fmt: skip
        if correction is None:
            raise InputError(f"episode {episode.episode_id} cannot be started")
        return correction

    return _walk_files(folder, walks, "dagger", walk)


def _walk_files(
    folder: Path,
    walks: Round,
    label: str,
    walk: Callable[[int, World, Eye, Episode], Correction | None],
) -> tuple[Path, ...]:
    """Walk the episodes of a round, and return the files of the walks that are not None.

    Walks whose file is there are not made again, and none is once all were made.
    """
    done = folder / "done"
    count = len(walks.episodes)
    with progress_bar(label, count, initial=count * done.is_file()) as bar:
        for number, start in enumerate(() if done.is_file() else walks.starts()):
            path = folder / f"{number:04d}.npz"
            if not path.is_file() and (correction := walk(number, *start)) is not None:
                write_correction(path, correction)
            bar.update()
    write_bytes(done, b"")
    return tuple(sorted(folder.glob("*.npz")))
