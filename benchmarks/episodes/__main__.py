"""Measure reading of VLN-CE files and sampling: `python -m benchmarks.episodes [scene …]`.

Without folders it generates an apartment and an office in their exact geometry. It reports CPU
seconds of one process, which do not depend on what else the machine does.
"""

import gzip
import json
import logging
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from tests.support.scenes.exact_scene import write_exact_scene
from vlnpe.apartments import build_scene, building_config
from vlnpe.formats.scene.bundle import SceneBundle, load_bundle
from vlnpe.formats.vlnce.files import read_vlnce, write_vlnce
from vlnpe.trajectory_sampler.config import SampleConfig
from vlnpe.trajectory_sampler.sampling import sample_episodes
from vlnpe.trajectory_sampler.similarity import PathIndex, stations

EPISODES = 15_000
PATHS = 60


def main() -> None:
    """Print the tables of the page."""
    logging.disable(logging.WARNING)
    with tempfile.TemporaryDirectory() as folder:
        _reading(Path(folder))
        _index()
        given = [load_bundle(Path(argument)) for argument in sys.argv[1:]]
        for bundle in given or _generated(Path(folder)):
            _sampling(bundle)


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def _reading(folder: Path) -> None:
    rng = np.random.default_rng(0)
    episodes = []
    for number in range(EPISODES):
        path = rng.uniform(-10, 10, (int(rng.integers(4, 9)), 3)).tolist()
        episodes.append(
            {
                "episode_id": number + 1,
                "trajectory_id": number // 3,
                "scene_id": f"mp3d/s{number % 61}/s{number % 61}.glb",
                "start_position": path[0],
                "start_rotation": [0, 0.5, 0, 0.866],
                "info": {"geodesic_distance": 6.4},
                "goals": [{"position": path[-1], "radius": 3.0}],
                "instruction": {
                    "instruction_text": "walk left past the door and stop " * 4,
                    "instruction_tokens": rng.integers(0, 2500, 200).tolist(),
                },
                "reference_path": path,
            }
        )
    file = folder / "train.json.gz"
    file.write_bytes(gzip.compress(json.dumps({"episodes": episodes}).encode(), 6))
    start = time.process_time()
    read = read_vlnce(file)
    _say(f"read {len(read.episodes)} episodes: {time.process_time() - start:.2f} CPU-s")
    start = time.process_time()
    write_vlnce(folder / "back.json.gz", read)
    _say(f"write them: {time.process_time() - start:.2f} CPU-s")


def _index() -> None:
    """Return the time of a look-up with few and with many paths kept, in ten villas."""
    rng = np.random.default_rng(0)
    for count in (100, 1_000, 10_000):
        index = PathIndex(2.0)
        # As dense as the preset's 61 paths of about 9 m in 220 m².
        side = np.sqrt(220 * count / 61)
        starts = rng.uniform(0, side, (count, 2))
        angles = rng.uniform(0, 2 * np.pi, count)
        ends = starts + 9 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        paths = [stations(np.array(pair)) for pair in zip(starts, ends, strict=True)]
        for path in paths:
            index.add(path)
        index.near(paths[0])
        start = time.process_time()
        for path in paths[:100]:
            index.near(path)
        _say(f"look-up among {count} paths: {10 * (time.process_time() - start):.2f} ms")


def _generated(folder: Path) -> list[SceneBundle]:
    made = []
    for kind in ("apartment", "office"):
        home = build_scene(np.random.default_rng(0), building_config(kind), painted=False)
        made.append(write_exact_scene(home, f"{kind}-0", folder / f"{kind}-0"))
    return made


def _sampling(bundle: SceneBundle) -> None:
    levels = range(len(bundle.level_floor_z_m))
    area = sum(
        float(np.isfinite(bundle.freemap(k).floor_z_m).sum()) * bundle.freemap(k).grid.cell_m ** 2
        for k in levels
    )
    config = SampleConfig(count=PATHS, relax=False, patience=60)
    start = time.process_time()
    result = sample_episodes(bundle, config, np.random.default_rng(0))
    seconds = time.process_time() - start
    pairs = len(result.episodes) + sum(
        count for reason, count in result.dropped.items() if reason != "no_goal_in_range"
    )
    length = float(np.mean([e.reference_length_m for e in result.episodes]))
    _say(
        f"{bundle.scene_id}: floor {area:.0f} m², {len(result.episodes)} of {PATHS} paths in "
        f"{seconds:.1f} CPU-s, {pairs / seconds:.1f} pairs/s, mean length {length:.1f} m"
    )


if __name__ == "__main__":
    main()
