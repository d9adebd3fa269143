"""Readers of episodes, recordings and datasets."""

import io
import json
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from .target import Target, saved


def _vlnce(folder: Path) -> Target:
    from tests.formats.vlnce.test_vlnce import PUBLIC, RXR
    from vlnpe.formats.vlnce.files import read_vlnce, write_vlnce

    def read(path: Path) -> None:
        write_vlnce(folder / "back.json", read_vlnce(path))

    seeds = [json.dumps(value).encode() for value in (PUBLIC, RXR)]
    return Target(seeds, saved(folder / "a.json.gz", read))


def _recipe(folder: Path) -> Target:
    from vlnpe.datasets.mixture.recipe import read_recipe
    from vlnpe.datasets.mixture.shipped import SHIPPED

    seeds = [path.read_bytes() for path in SHIPPED.values()]
    seeds.append(b"recipe: 1\ntitle: t\nsources: &s {a: {robots: [h1]}}\nmixtures: {m: {a: 1.5}}\n")
    return Target(seeds, saved(folder / "a.yaml", read_recipe))


def _mcap(folder: Path) -> Target:
    from tests.formats.convert.test_convert import export_mcap
    from tests.support.rollouts import make_rollout
    from vlnpe.formats.convert.episodes import unit_from_mcap
    from vlnpe.formats.mcap.rollout import read_rollout, write_rollout

    write_rollout(folder / "seed.mcap", make_rollout(0.05))
    (folder / "whole").mkdir()
    whole = export_mcap(folder / "whole", make_rollout(0.0)).read_bytes()

    def read(path: Path) -> None:
        shutil.rmtree(folder / "out", ignore_errors=True)
        read_rollout(path)
        unit_from_mcap(path, folder / "out" / "unit")

    return Target([(folder / "seed.mcap").read_bytes(), whole], saved(folder / "a.mcap", read))


def _lerobot(pattern: str, folder: Path) -> Target:
    from tests.formats.convert.test_convert import ASSEMBLY
    from tests.security.test_lerobot import convert, load
    from tests.support.lerobot_data import write_units
    from vlnpe.formats.core.errors import VlnpeError
    from vlnpe.formats.lerobot import assemble_dataset

    root = folder / "set"
    assemble_dataset(write_units(folder, (0.0,)), root, **ASSEMBLY)
    path = next(p for p in sorted(root.glob(pattern)) if p.is_file())
    seed = path.read_bytes()

    def read(_: Path) -> None:
        shutil.rmtree(folder / "out", ignore_errors=True)
        try:
            load(root)
        except VlnpeError:
            convert(root)
            raise
        convert(root)

    return Target([seed], saved(path, read))


def _internnav(pattern: str, folder: Path) -> Target:
    from tests.formats.internnav.layouts import make_unit
    from vlnpe.formats.internnav.reader import find_scenes, read_layout_episode
    from vlnpe.formats.internnav.writer import SceneEpisode, share_instructions, write_scene
    from vlnpe.formats.lerobot import read_episode_unit
    from vlnpe.formats.vlnce.vocabulary import Vocabulary

    unit = make_unit(folder, 0, 0.5)
    tasks = share_instructions([read_episode_unit(unit)])
    scene = folder / "n1" / "r2r" / "two-rooms"
    words = Vocabulary.of(tasks[0])
    write_scene(scene, [SceneEpisode(unit, tasks[0])], words, every_frame=True)
    path = next(p for p in sorted(scene.glob(pattern)) if p.is_file())
    seed = path.read_bytes()

    def read(_: Path) -> None:
        find_scenes(folder / "n1")
        episode = read_layout_episode(scene, 0)
        for images in (episode.rgb, episode.depth):
            np.asarray(images[:1])

    return Target([seed], saved(path, read))


def _arrays(folder: Path) -> Target:
    from vlnpe.formats.untrusted.arrays import read_arrays

    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, a=np.arange(9), b=np.zeros((2, 3), np.float32))
    return Target([stream.getvalue()], saved(folder / "a.npz", read_arrays))


DATASETS: dict[str, Callable[[Path], Target]] = {
    "vlnce": _vlnce,
    "recipe": _recipe,
    "mcap": _mcap,
    "npz": _arrays,
    "lerobot-info": partial(_lerobot, "meta/info.json"),
    "lerobot-episodes": partial(_lerobot, "meta/episodes/*/*.parquet"),
    "lerobot-rows": partial(_lerobot, "data/*/*.parquet"),
    "lerobot-video": partial(_lerobot, "videos/*rgb/*/*.mp4"),
    "n1-info": partial(_internnav, "meta/info.json"),
    "n1-tasks": partial(_internnav, "meta/tasks.jsonl"),
    "n1-stats": partial(_internnav, "meta/episodes_stats.jsonl"),
    "n1-rows": partial(_internnav, "data/*/*.parquet"),
    "n1-npy": partial(_internnav, "videos/*/*depth/*.npy"),
}
