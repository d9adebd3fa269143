"""Open each output of a run with a reader, and check that its parts agree."""

import gzip
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

from mcap.reader import make_reader

from ...formats.internnav.reader import find_scenes, read_layout_episode
from ...formats.lerobot.units.unit import read_episode_unit
from ...formats.mcap.rollout import read_rollout
from ...formats.rendered.folder import read_frame_folder
from ...formats.scene.bundle import load_bundle
from ...formats.scene.visibility import read_visibility
from ...formats.video.stream import demux_packets, open_video, probe_video
from ...formats.vlnce.files import read_episodes, read_vlnce
from ...instruction_gen.facts.named import read_named
from ...scene_repair.verify.scene import verify_scene
from .dataset import check_dataset


def check_output(stage: str, path: Path) -> None:
    """Open one output of a stage.

    Raises:
        Exception: Whatever is wrong with it; of any type if it is damaged.
    """
    if not path.exists():
        raise ValueError("missing")
    if path.is_file() and path.stat().st_size == 0:
        raise ValueError("empty")
    READERS.get(stage, lambda _: None)(path)


def check_scene(path: Path) -> None:
    """Raise ValueError unless a repaired scene carries robots everywhere; see `verify_scene`."""
    problems = verify_scene(load_bundle(path))["problems"]
    if problems:
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        raise ValueError(f"{problems[0]}{more}")


def _rollout(path: Path) -> None:
    rollout = read_rollout(path)
    times = rollout.time_s
    if len(times) > 1 and (times[1:] <= times[:-1]).any():
        raise ValueError("timestamps do not increase")


def _frames(path: Path) -> None:
    folder = read_frame_folder(path)
    counts = {name: len(folder.arrays[name]) for name in ("sample_index", "time_s")}
    counts |= {video.name: _packets(video) for video in sorted(path.glob("*.m[op][4v]"))}
    counts["meta.json"] = folder.facts["frames"]
    if len(set(counts.values())) > 1:
        raise ValueError(f"frame counts differ: {_listed(counts)}")
    rate = folder.frames_per_second
    rates = {v.name: probe_video(v).frames_per_second for v in (folder.rgb_video,)}
    if any(value != rate for value in rates.values()):
        raise ValueError(f"frame rates differ: meta.json {rate}, {_listed(rates)}")


def _unit(path: Path) -> None:
    unit = read_episode_unit(path)
    counts = {"unit.json": unit.length, "rows.parquet": unit.rows().num_rows}
    counts |= {video.name: _packets(video) for video in sorted(path.glob("*.mp4"))}
    if len(set(counts.values())) > 1:
        raise ValueError(f"frame counts differ: {_listed(counts)}")
    times = unit.rows()["timestamp"].to_numpy()
    expected = [k / unit.frames_per_second for k in range(unit.length)]
    if abs(times - expected).max() > 1e-4:
        raise ValueError(f"timestamps are not multiples of 1/{unit.frames_per_second} s")


def _packets(video: Path) -> int:
    """Return how many frames a video has, reading all of its packets."""
    with open_video(video) as container:
        return sum(1 for _ in demux_packets(video, container, container.streams.video[0]))


def _listed(counts: dict[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.items())


def _mcap(path: Path) -> None:
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        if summary is None or summary.statistics is None:
            raise ValueError("it has no index")
        count, last_ns = 0, 0
        for _, _, message in reader.iter_messages():
            count += 1
            if message.log_time < last_ns:
                raise ValueError(f"message {count} is earlier than the one before it")
            last_ns = message.log_time
        if count != summary.statistics.message_count:
            raise ValueError(f"{count} messages, its index says {summary.statistics.message_count}")


def _instructed(path: Path) -> None:
    """Read an episode file, or the facts records beside it."""
    if path.parent.name == "facts":
        json.loads(gzip.decompress(path.read_bytes()))
    else:
        read_episodes(path)


def _layout(path: Path) -> None:
    for scene in find_scenes(path):
        for number in scene.episodes:
            read_layout_episode(scene.folder, number)


READERS: dict[str, Callable[[Path], object]] = {
    "repair": check_scene,
    "sample": read_episodes,
    "align": read_episodes,
    "drive": read_episodes,
    # Episodes of others as they were, without what we write into ours.
    "filter": partial(read_vlnce, strict=True),
    "look": read_visibility,
    "name": lambda path: read_named([path]),
    "instruct": _instructed,
    "replay": _rollout,
    "evaluate": _rollout,
    "render": _frames,
    "export": _unit,
    "unit": _unit,
    "mcap": _mcap,
    "dataset": check_dataset,
    "lerobot": check_dataset,
    "n1": _layout,
}
