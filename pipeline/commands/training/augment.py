"""More paths in the scenes of a training, with texts, for `vlnpe train --augment`."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ....formats.core.atomic import write_json
from ....formats.core.episode import Episode
from ....formats.core.errors import FileFormatError, InputError, SceneError
from ....formats.lerobot.splits import TRAIN, is_published_holdout
from ....formats.scene.bundle import load_bundle
from ....formats.untrusted.documents import read_json
from ....formats.vlnce.files import read_episodes, write_episodes
from ....instruction_gen.instruct import instruct_episodes, path_generator
from ....instruction_gen.records import InstructConfig
from ....learning.training.holdout import scene_of
from ....learning.training.plan import Planned
from ....trajectory_sampler.config import SampleConfig
from ....trajectory_sampler.sampling import sample_episodes
from ...inputs.crews import chosen_robots
from ...inputs.episode_file import episodes_of
from ...options.training import Train

logger = logging.getLogger(__name__)

_MADE_BY = "made_by.json"  # file of the settings that paths were made with
EPISODES = "episodes.json.gz"


def more_episodes(
    options: Train, run: Path, planned: Planned, seed: int, folder: Path
) -> tuple[list[Episode], Path]:
    """Return about `options.augment` new episodes with texts, and the folder of their scenes.

    They are spread evenly over the scenes that the training's episodes lie in, and kept in
    `folder`. Texts are the composer's, of what the map alone shows.
    """
    (robot,) = chosen_robots(options.robot)
    run_episodes, scenes = episodes_of(run, None, None)
    paths = [t for s in planned.plan.sources for t in s.selection.trajectories()]
    names = sorted({scene_of(path) for path in paths})
    if lacking := [name for name in names if not (scenes / name).is_dir()]:
        raise InputError(
            f"{scenes}: lacks {', '.join(lacking)}, where the training's episodes lie; name the "
            "run that they were collected in with --run FOLDER"
        )
    made_by = {
        "augment": options.augment,
        "robot": [robot.name, robot.content_sha256],
        "seed": seed,
        "episodes": [s.selection.digest for s in planned.plan.sources],
    }
    _check_made_by(folder, made_by)
    file = folder / EPISODES
    if file.is_file():
        return read_episodes(file), scenes
    held = planned.holdout.trajectories
    avoid = [
        episode
        for episode in run_episodes
        if is_published_holdout(episode.split)
        or f"{episode.scene_id}/{episode.trajectory_id}" in held
    ]
    available = {f"{episode.scene_id}/{episode.trajectory_id}" for episode in run_episodes}
    if unknown := sorted(t for t in held - available if scene_of(t) in names):
        raise InputError(
            f"{run}: lacks the episode of {unknown[0]}, which is held out; --augment keeps away "
            "from held-out paths, so name the run that holds them with --run FOLDER"
        )
    episodes: list[Episode] = []
    for number, name in enumerate(names):
        count = options.augment // len(names) + (number < options.augment % len(names))
        if count:
            sampling = SampleConfig(count=count, robot_radius_m=robot.footprint_radius_m)
            near = [episode for episode in avoid if episode.scene_id == name]
            episodes += _sample(scenes / name, sampling, near, seed)
    texts = instruct_episodes(episodes, scenes, InstructConfig(), seed)
    for episode, reason in texts.failed.items():
        logger.warning("--augment: %s has no true text and is left out: %s", episode, reason)
    if not texts.episodes:
        raise InputError("--augment: no further path was found in the training's scenes")
    write_json(folder / _MADE_BY, made_by)
    write_episodes(file, texts.episodes)
    return texts.episodes, scenes


def _sample(
    scene: Path, config: SampleConfig, avoid: Sequence[Episode], seed: int
) -> list[Episode]:
    """Return new training episodes of one scene; none, with a warning, where none is found."""
    bundle = replace(load_bundle(scene), scene_id=scene.name)
    try:
        result = sample_episodes(bundle, config, path_generator(seed, scene.name), avoid=avoid)
    except SceneError as error:
        logger.warning("--augment: %s", error)
        return []
    names = [f"{episode.episode_id}-augmented" for episode in result.episodes]
    return [
        replace(episode, episode_id=name, trajectory_id=name, split=TRAIN)
        for episode, name in zip(result.episodes, names, strict=True)
    ]


def _check_made_by(folder: Path, made_by: Mapping[str, Any]) -> None:
    """Raise FileFormatError if paths in a folder were made with other settings, or unknown ones."""
    file = folder / _MADE_BY
    recorded = read_json(file) if file.is_file() else made_by
    if recorded != made_by or (not file.is_file() and (folder / EPISODES).is_file()):
        raise FileFormatError(file, "walked with other settings or data; use another output folder")
