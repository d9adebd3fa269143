"""Frames written per second as LeRobot v3 with depth, against LeRobot's own writer.

All writers get the same decoded frames, mapped from files in the page cache, and
writes videos of the same codecs and settings. LeRobot's streaming writer drops frames when its
queue is full; here the queue takes a whole episode.
"""

import logging
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import replace
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from vlnpe.formats.core.rollout import Rollout
from vlnpe.formats.core.threads import available_cores
from vlnpe.formats.lerobot import assemble_dataset, write_episode_unit
from vlnpe.formats.mcap.rollout import read_rollout
from vlnpe.formats.rendered.folder import FrameFolder, read_frame_folder
from vlnpe.formats.rendered.image_counts import new_depth_counts, new_rgb_counts
from vlnpe.formats.rendered.table import build_frame_table
from vlnpe.formats.video.mp4 import (
    DEPTH_CODEC,
    RGB_CODECS,
    read_depth_video,
    read_rgb_video,
    write_depth_video,
    write_rgb_video,
)
from vlnpe.pipeline.engine.ledger import Ledger

EPISODES = 24
ROUNDS = 2
FEW, MANY = 8, 64  # episodes whose peak memories are compared

RGB, DEPTH = "observation.images.rgb", "observation.images.depth"

# LeRobot's ways to write: options of `LeRobotDataset.create`, our codecs except for the first.
# Encoding in batches of episodes (`batch_encoding_size`) breaks in LeRobot 0.6.1.
WAYS: dict[str, dict[str, Any]] = {
    "as it comes (AV1, x265 medium)": {"own_codecs": True},
    "images first, both videos encoded in parallel": {},
    "images first by 4 threads": {"image_writer_threads": 4},
    "streaming": {"streaming_encoding": True},
    "streaming, encoders with threads of their own": {
        "streaming_encoding": True,
        "threaded": True,
    },
}


def report(run: Path) -> str:
    """Write the run's rendered frames again and again; return a Markdown section."""
    with tempfile.TemporaryDirectory(prefix="vlnpe-write-") as name:
        folder = Path(name)
        sources = _decode(run, folder)
        count = sum(len(_load(source)[2]) for source in sources)
        rates = _rates(sources, folder, count)
        few, many = (_peak_mib(sources[0], folder, number) for number in (FEW, MANY))
    best = max(rate for name, rate in rates.items() if name in WAYS)
    rows = [f"| {name} | {rate:.0f} | {rate / best:.2f} |" for name, rate in rates.items()]
    return "\n".join(
        [
            "## Writing LeRobot v3 with depth",
            "",
            f"{len(sources)} episodes, {count} frames of 256 × 256 RGB and lossless depth, the",
            "same codecs and settings but in the first row; best of "
            f"{ROUNDS}. Ratios are to the best of LeRobot's own writer.",
            "",
            "| writer | frames/s | ratio |",
            "| --- | ---: | ---: |",
            *rows,
            "",
            f"Peak memory of assembling {FEW} episodes {few:.0f} MiB, {MANY} episodes "
            f"{many:.0f} MiB.",
            "",
        ]
    )


def _rates(sources: Sequence[Path], folder: Path, count: int) -> dict[str, float]:
    """Return the frames per second of each way, best of some rounds taken in turn."""
    logging.getLogger("lerobot").setLevel(logging.ERROR)
    cores = available_cores()
    with ProcessPoolExecutor(cores, mp_context=get_context("spawn")) as pool:
        # Workers of a run have long imported everything, and have what they write in memory.
        list(pool.map(_load_all, [list(sources)] * 8 * cores))
        ways: dict[str, Callable[[Path], None]] = {
            name: _lerobot_way(sources, dict(options)) for name, options in WAYS.items()
        }
        ways["**vlnpe, one process**"] = lambda out: _ours(sources, out, None)
        ways[f"**vlnpe, {cores} processes**"] = lambda out: _ours(sources, out, pool)
        best = dict.fromkeys(ways, np.inf)
        for _ in range(ROUNDS):
            for name, write in ways.items():
                out = folder / "out"
                started = time.perf_counter()
                write(out)
                best[name] = min(best[name], time.perf_counter() - started)
                shutil.rmtree(out)
    return {name: count / seconds for name, seconds in best.items()}


def _decode(run: Path, folder: Path) -> list[Path]:
    """Decode rendered episodes into folders that `_load` maps."""
    ledger = Ledger.existing(run)
    rows = [row for row in ledger.rows("render") if row.status == "done"][:EPISODES]
    sources = []
    for row in rows:
        seen = read_frame_folder(run / row.outputs[0])
        source = folder / Path(row.outputs[0]).name
        shutil.copytree(run / row.outputs[0], source)
        shutil.copy(run / str(row.facts["rollout"]), source / "rollout.mcap")
        np.save(source / "rgb.npy", read_rgb_video(seen.rgb_video))
        np.save(source / "depth.npy", read_depth_video(seen.depth_video, seen.depth_range))
        sources.append(source)
    return sources


@cache
def _load(source: Path) -> tuple[Any, FrameFolder, np.ndarray, np.ndarray]:
    """Return the rollout, the render stage's facts, RGB (T, H, W, 3) and depth (T, H, W).

    Read once.
    """
    seen = read_frame_folder(source)
    arrays = {k: v for k, v in seen.arrays.items() if not k.endswith("_counts")}
    rgb = np.load(source / "rgb.npy", mmap_mode="r", allow_pickle=False)
    depth = np.load(source / "depth.npy", mmap_mode="r", allow_pickle=False)
    return read_rollout(source / "rollout.mcap"), replace(seen, arrays=arrays), rgb, depth


def _load_all(sources: list[Path]) -> None:
    for source in sources:
        _load(source)


def _ours(sources: Sequence[Path], out: Path, pool: Executor | None) -> None:
    """Write a dataset as the stages render and export do."""
    units = [out / "units" / source.name for source in sources]
    jobs = zip(sources, units, strict=True)
    list((pool.map if pool else map)(_unit, *zip(*jobs, strict=True)))
    assemble(units, out / "dataset")


def _unit(source: Path, unit: Path) -> None:
    rollout, seen, rgb, depth = _load(source)
    videos = unit.parent / f"{unit.name}-videos"
    rgb_counts, depth_counts = new_rgb_counts(), new_depth_counts()
    rate = seen.frames_per_second
    write_rgb_video(videos / "rgb.mp4", rgb, rate, counts=rgb_counts)
    write_depth_video(videos / "depth.mp4", depth, rate, seen.depth_range, counts=depth_counts)
    arrays = {**seen.arrays, "rgb_counts": rgb_counts, "depth_counts": depth_counts}
    encoded = replace(
        seen,
        arrays=arrays,
        rgb_video=videos / "rgb.mp4",
        depth_video=videos / "depth.mp4",
        rgb_codec="h264",
    )
    write_episode_unit(unit, rollout, encoded)


def assemble(units: Sequence[Path], out: Path) -> None:
    assemble_dataset(units, out, provenance={}, licence="apache-2.0", title="benchmark")


def _lerobot_way(sources: Sequence[Path], options: dict[str, Any]) -> Callable[[Path], None]:
    from lerobot.configs import DepthEncoderConfig, RGBEncoderConfig
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    own, threaded = options.pop("own_codecs", False), options.pop("threaded", False)
    loaded = [_load(source) for source in sources]
    rate, far_m = loaded[0][1].frames_per_second, loaded[0][1].depth_range.far_m
    tables = [build_frame_table(rollout, seen.arrays, rate) for rollout, seen, *_ in loaded]
    kept = features(tables[0], loaded[0][2].shape[1:3])
    if options.get("streaming_encoding"):
        options["encoder_queue_maxsize"] = max(len(table) for table in tables) + 1
    if own:
        codecs = {"depth_encoder": DepthEncoderConfig(depth_min=0.0, depth_max=far_m)}
    else:
        h264, hevc = RGB_CODECS["h264"], DEPTH_CODEC
        colour, depth = dict(h264.extra_options), dict(hevc.extra_options)
        if threaded:
            colour.pop("threads")
            depth["x265-params"] = str(depth["x265-params"]).replace(":pools=none", "")
        codecs = {
            "rgb_encoder": RGBEncoderConfig(
                vcodec="h264", crf=h264.crf, preset=h264.preset, extra_options=colour
            ),
            "depth_encoder": DepthEncoderConfig(
                depth_min=0.0, depth_max=far_m, preset=hevc.preset, extra_options=depth
            ),
        }

    def write(out: Path) -> None:
        dataset = LeRobotDataset.create(
            "vlnpe/benchmark", rate, kept, root=out, robot_type="any", **codecs, **options
        )
        for (rollout, _, rgb, depth), table in zip(loaded, tables, strict=True):
            add_episode(dataset, rollout, table, zip(rgb, depth, strict=True))
        dataset.finalize()
        written = dataset.meta.total_frames
        if written != sum(map(len, tables)):
            raise RuntimeError(f"LeRobot wrote {written} frames")

    return write


def add_episode(dataset: Any, rollout: Rollout, table: Any, pictures: Iterable[Any]) -> None:
    """Give LeRobot's writer an episode, whose pictures are colour (H, W, 3) and depth (H, W)."""
    for i, (rgb, depth) in enumerate(pictures):
        frame = {key: values[i] for key, values in table.columns.items()}
        frame |= {RGB: rgb, DEPTH: depth[..., None]}
        dataset.add_frame(frame | {"task": rollout.episode.instruction})
    dataset.save_episode()


def features(table: Any, size: tuple[int, ...]) -> dict[str, Any]:
    names = ["height", "width", "channels"]
    images = {
        RGB: {"dtype": "video", "shape": (*size, 3), "names": names},
        DEPTH: {
            "dtype": "video",
            "shape": (*size, 1),
            "names": names,
            "info": {"is_depth_map": True},
        },
    }
    columns = {
        key: {
            "dtype": str(values.dtype),
            "shape": (values.shape[1],),
            "names": table.column_names[key],
        }
        for key, values in table.columns.items()
    }
    return columns | images


def _peak_mib(source: Path, folder: Path, episodes: int) -> float:
    """Return the peak memory of a process that assembles the same unit many times."""
    unit = folder / "one" / "unit"
    if not unit.is_dir():
        _unit(source, unit)
    out = folder / f"many-{episodes}"
    code = (
        "from pathlib import Path\n"
        "from benchmarks.writing.write import assemble\n"
        f"assemble([Path({str(unit)!r})] * {episodes}, Path({str(out)!r}))\n"
        # Unlike ru_maxrss it does not begin with what this process had when it forked.
        "status = Path('/proc/self/status').read_text().split()\n"
        "print(status[status.index('VmHWM:') + 1])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=Path(__file__).resolve().parents[2],
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    shutil.rmtree(out)
    return int(done.stdout.split()[-1]) / 1024
