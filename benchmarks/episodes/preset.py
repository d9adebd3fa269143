"""Sample a preset, and check the episode files: `python -m benchmarks.episodes.preset FOLDER`.

FOLDER holds the repaired scenes of a preset: the preset is sampled with one worker and with two,
and both results must be the same bytes. With `--read` FOLDER holds episode files and their scenes
are given apart: `python -m benchmarks.episodes.preset --read RUN/episodes RUN/scenes`.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from itertools import combinations, permutations
from pathlib import Path

import numpy as np

from vlnpe.collectors.robots.registry import get_robot
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.geometry import path_length, point_along
from vlnpe.formats.scene.bundle import SceneBundle, load_bundle
from vlnpe.formats.vlnce.files import read_episodes
from vlnpe.formats.vlnce.groups import instruction_count
from vlnpe.trajectory_sampler.candidates import LENGTH_BIN_M
from vlnpe.trajectory_sampler.presets import get_preset
from vlnpe.trajectory_sampler.record import clearance_at
from vlnpe.trajectory_sampler.similarity import path_gap
from vlnpe.wayfinding.planning import segments_free

CHECKED_EVERY_M = 0.02


def main() -> int:
    """Print the tables; return 1 if a promise of the preset is broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--read", type=Path, metavar="EPISODES", help="check these episode files")
    parser.add_argument("--preset", default="gru_vln10")
    parser.add_argument("--robot", default="aliengo", help="that the paths are to keep clear for")
    options = parser.parse_args()
    if options.read:
        return report(sorted(options.read.glob("*.json.gz")), options)
    with tempfile.TemporaryDirectory() as folder:
        outs = [Path(folder) / f"{workers}" for workers in (1, 2)]
        for workers, out in enumerate(outs, 1):
            sample(options.folder, out, options.preset, options.robot, workers)
        one, two = (sorted(out.glob("*.json.gz")) for out in outs)
        same = [a.read_bytes() for a in one] == [b.read_bytes() for b in two]
        say(f"one worker and two give {'the same bytes' if same else 'DIFFERENT files'}")
        return max(report(one, options), int(not same))


def sample(scenes: Path, out: Path, preset: str, robot: str, workers: int) -> None:
    """Run `vlnpe sample` and print how long it took."""
    command = [str(Path(sys.executable).with_name("vlnpe")), "sample", str(scenes)]
    command += ["--preset", preset]
    command += ["--robot", robot, "--workers", str(workers), "--out", str(out)]
    before, start = cpu_s(), time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    took = time.perf_counter() - start
    say(f"{workers} worker(s): {cpu_s() - before:.1f} CPU-s, {took:.1f} s")


def cpu_s() -> float:
    """Return the CPU seconds of all ended child processes."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def report(files: Sequence[Path], options: argparse.Namespace) -> int:
    """Print what the files hold, and return 1 if a promise of the preset is broken."""
    preset = get_preset(options.preset)
    radius_m = get_robot(options.robot).footprint_radius_m
    by_split = {file.name.split(".")[0]: read_episodes(file) for file in files}
    episodes = [episode for some in by_split.values() for episode in some]
    bundles = {n: load_bundle(options.folder / n) for n in {e.scene_id for e in episodes}}
    broken = []
    for split, some in by_split.items():
        scenes = Counter(e.scene_id for e in some)
        instructions = instruction_count(some)
        say(f"{split}: {len(some)} paths, {instructions} instructions, {len(scenes)} scenes")
    counts = {split: len(some) for split, some in by_split.items()}
    if counts != dict(preset.splits):
        broken.append(f"counts {counts}, not {dict(preset.splits)}")
    clearances = [clearance_m(bundles[e.scene_id], e) for e in episodes]
    touching = sum(not is_free(bundles[e.scene_id], e, radius_m) for e in episodes)
    say(f"least clearance of any path {min(clearances):.3f} m; footprint {radius_m:g} m")
    say(f"{touching} paths with a segment that is not free for the footprint")
    if touching or min(clearances) < radius_m:
        broken.append("a path is nearer to an obstacle than the footprint")
    same, other = nearest_pairs(episodes)
    say(f"nearest pair of one scene {same:.2f} m, of different splits {other:.2f} m (both ways)")
    trained = {e.scene_id for s, some in by_split.items() if "unseen" not in s for e in some}
    unseen = {e.scene_id for s, some in by_split.items() if "unseen" in s for e in some}
    if trained & unseen:
        broken.append(f"trained in and unseen: {sorted(trained & unseen)}")
    lengths = np.array([e.reference_length_m for e in episodes])
    say(f"mean length {lengths.mean():.2f} m, standard deviation {lengths.std():.2f} m")
    bins = Counter((lengths // LENGTH_BIN_M).astype(int).tolist())
    for number in sorted(bins):
        low = number * LENGTH_BIN_M
        say(f"  {low:2.0f} … {low + LENGTH_BIN_M:2.0f} m: {bins[number]}")
    passages = Counter(len(e.extra["crossings"]) for e in episodes)
    say(f"passages from room to room: {dict(sorted(passages.items()))}")
    for problem in broken:
        say(f"BROKEN: {problem}")
    return int(bool(broken))


def clearance_m(bundle: SceneBundle, episode: Episode) -> float:
    """Return the least distance [m] of an episode's path to what cannot be walked on."""
    path = episode.reference_path_world_m
    along = np.arange(0.0, path_length(path), CHECKED_EVERY_M)
    return float(clearance_at(bundle.freemap(episode.level), point_along(path, along)).min())


def is_free(bundle: SceneBundle, episode: Episode, radius_m: float) -> bool:
    """Return whether every segment of the path leads over cells free for `radius_m` [m]."""
    freemap = bundle.freemap(episode.level)
    path = episode.reference_path_world_m
    return bool(segments_free(freemap.grid, freemap.free(radius_m), path).all())


def nearest_pairs(episodes: Sequence[Episode]) -> tuple[float, float]:
    """Return the least gap [m] of two paths of one scene and split, and of different splits."""
    groups: dict[tuple[str, int], list[Episode]] = {}
    for episode in episodes:
        groups.setdefault((episode.scene_id, episode.level), []).append(episode)
    same = other = np.inf
    for some in groups.values():
        for a, b in combinations(some, 2):
            paths = (a.reference_path_world_m, b.reference_path_world_m)
            if a.split == b.split:
                same = min(same, *(path_gap(x, y) for x, y in permutations(paths)))
            else:
                back = paths[1][::-1]
                other = min(other, path_gap(*paths), path_gap(paths[0], back))
    return float(same), float(other)


def say(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    raise SystemExit(main())
