"""Scenes in the layout, ours and as others write it, and what InternNav reads of them."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tests.support.lerobot_data import write_unit
from tests.support.rollouts import make_rollout
from vlnpe.formats.core.rollout import Rollout

RGB, DEPTH = "observation.images.rgb", "observation.images.depth"


def loader_keys(root: Path, scans: list[str]) -> Iterator[str]:
    """Keys as InternRobotics/InternNav's LerobotAsLmdb.get_all_keys makes them.

    internnav/utils/lerobot_as_lmdb.py: scan folders that are asked for, scenes with data/, chunks.
    """
    for scan in (p for p in root.iterdir() if p.is_dir() and p.name in scans):
        for scene in (p for p in scan.iterdir() if p.is_dir()):
            for file in sorted(scene.glob("data/chunk-*/episode_*.parquet")):
                chunk, number = int(file.parent.name[6:]), int(file.stem[8:])
                yield f"{scan.name}_{scene.name}_{chunk:03d}_{number:06d}"


def loader_data(root: Path, key: str) -> dict[str, Any]:
    """What LerobotAsLmdb.get_data_by_key reads for a key, by its names."""
    parts = key.split("_")
    scan = parts.pop(0)
    if parts[0] in ("flash", "aliengo"):
        scan = f"{scan}_{parts.pop(0)}"
    scene, chunk, number = root / scan / parts[0], int(parts[-2]), int(parts[-1])
    name = f"chunk-{chunk:03d}/episode_{number:06d}"
    table = pq.read_table(scene / "data" / f"{name}.parquet").to_pydict()
    first = last = 0
    for line in (scene / "meta/episodes_stats.jsonl").read_text().splitlines():
        task_line = json.loads(line)
        if task_line["episode_index"] == number:
            first, last = task_line["task_index"]["min"], task_line["task_index"]["max"]
    lines = (scene / "meta/tasks.jsonl").read_text().splitlines()
    tasks = [t for t in map(json.loads, lines) if first <= t["task_index"] <= last]
    videos = scene / "videos" / f"chunk-{chunk:03d}"
    seen = {k: v for k, v in table.items() if k.startswith("observation.")}
    column = {k.removeprefix("observation."): np.array(v) for k, v in seen.items()}
    return {
        "tasks": tasks,
        "rgb": np.load(videos / RGB / f"episode_{number:06d}.npy"),
        "depth": np.load(videos / DEPTH / f"episode_{number:06d}.npy"),
        **{k: column[f"robot_{k}"] for k in ("position", "orientation", "yaw")},
        **{f"camera_{k}": column[f"camera_{k}"] for k in ("position", "orientation", "yaw")},
        **{k: column[k] for k in ("progress", "step", "action")},
    }


def make_unit(root: Path, number: int, seconds: float = 2.0, **changes: Any) -> Path:
    rollout = make_rollout(seconds, number, discrete=True, fall=number == 2)
    return write_unit(root, replace(rollout, robot="h1", **changes), number)


def truth(number: int) -> Rollout:
    return make_rollout(2.0 + number, number, discrete=True, fall=number == 2)


def make_foreign(layout: Path, scan: str = "r2r") -> Path:
    """The layout as others write it: no columns or files of ours, wrong rates, no robot."""
    scene = layout / "r2r" / "two-rooms"
    (scene / "meta" / "vlnpe_episodes.jsonl").unlink()
    info = json.loads((scene / "meta" / "info.json").read_text())
    info |= {"fps": 30, "robot_type": "unknown"}
    (scene / "meta" / "info.json").write_text(json.dumps(info))
    for path in scene.glob("data/chunk-000/*.parquet"):
        table = pq.read_table(path)
        names = [n for n in table.schema.names if n in info["features"]]
        table = table.select(names)
        at = names.index("timestamp")
        stamps = pa.array(np.arange(table.num_rows, dtype=np.float32) / 6)
        pq.write_table(table.set_column(at, "timestamp", stamps), path)
    if scan != "r2r":
        scene.parent.rename(layout / scan)
    return layout
