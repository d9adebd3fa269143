"""What a training does in closed loop: validation, and DAgger."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ....collectors.controllers import controller_for
from ....collectors.rendering.camera.views import CameraOverrides
from ....collectors.replay import ReplayConfig
from ....evaluation.dagger import corrected_walk
from ....evaluation.episode import closed_loop
from ....evaluation.learned import LearnedPolicy
from ....evaluation.rounds import Round, spread
from ....formats.core.errors import InputError
from ....formats.core.progress import progress_bar
from ....learning.card import Card
from ....learning.checkpoint import Checkpoint, load_checkpoint
from ....learning.models.registry import Model
from ....learning.training.corrections import write_correction
from ....learning.training.curves import Validation
from ....learning.training.session import Request, Result, train_recipe
from ...inputs.crews import chosen_robots
from ...inputs.episodes import asked_episodes
from ...inputs.views import chosen_views
from ...options.training import Train


@dataclass(frozen=True)
class _Walks:
    """Episodes of a run, and how a model that is being trained walks them."""

    options: Train
    split: str | None

    def round(self, card: Card, count: int, held_out: frozenset[str] = frozenset()) -> Round:
        """Return up to `count` episodes, evenly spread, none of a trajectory that is held out."""
        options = self.options
        if options.run is None:
            raise InputError(
                "--validate and --dagger need the episodes of a run; name it with --run FOLDER"
            )
        episodes, scenes = asked_episodes(options.run, None, self.split)
        episodes = [e for e in episodes if f"{e.scene_id}/{e.trajectory_id}" not in held_out]
        (robot,) = chosen_robots(options.robot)
        controller_for(robot, options.controller)
        light = card.lights[0] if len(card.lights) == 1 else "baked"
        camera = card.view.camera("ego")
        (view,) = chosen_views(camera, light, "auto", robot, CameraOverrides())
        config = ReplayConfig(robot=options.robot, controller=options.controller)
        return Round(spread(episodes, count), scenes, view, closed_loop(config))


def validation(options: Train) -> Validation | None:
    """Return what scores a model in closed loop; SR counts stops within 3 m, as in `evaluate`."""
    if not options.validate:
        return None

    def validate(model: Model, card: Card) -> dict[str, float]:
        policy = LearnedPolicy(Checkpoint(card, model, ""))
        walks = _Walks(options, options.validate_split).round(card, options.validate)
        found = [walk.metrics for walk in walks.walk(policy)]
        return {
            "SR": 100 * sum(m.success for m in found) / len(found),
            "OS": 100 * sum(m.oracle_success for m in found) / len(found),
            "NE": sum(m.navigation_error_m for m in found) / len(found),
        }

    return validate


def dagger(options: Train, request: Request, result: Result) -> Result:
    """Let each model walk, and go on training with the expert's corrections of all rounds."""
    files: list[Path] = []
    for number in range(1, options.dagger + 1):
        folder = options.out / f"dagger-{number}"
        checkpoint = load_checkpoint(result.checkpoint)
        held_out = frozenset(checkpoint.card.held_out["trajectories"])
        walks = _Walks(options, None).round(checkpoint.card, options.dagger_episodes, held_out)
        # The expert's share halves from round to round, as in VLN-CE.
        files += _corrections(folder / "walks", walks, checkpoint, 0.5**number)
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
    folder: Path, walks: Round, checkpoint: Checkpoint, expert_share: float
) -> list[Path]:
    """Return the files of corrected walks; those that are there already are not walked again."""
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"{number:04d}.npz" for number in range(len(walks.episodes))]
    done = all(path.is_file() for path in files)
    with progress_bar("dagger", len(files), initial=len(files) * done) as bar:
        for number, (world, eye, episode) in enumerate(() if done else walks.starts()):
            rng = np.random.default_rng(number)
            walk = corrected_walk(
                world, episode, walks.config, checkpoint, eye, expert_share=expert_share, rng=rng
            )
            write_correction(files[number], walk)
            bar.update()
    return files
