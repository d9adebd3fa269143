"""A scene in LeRobot v2.1's shape, as InternNav's loaders read it."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from .depth_png import write_png
from .subset import folder_of, write_lines
from .walks import Walk

RGB, DEPTH = "observation.images.rgb", "observation.images.depth"


@dataclass(frozen=True)
class DepthFormat:
    """How a layout stores depth: whole numbers of 1 / `per_metre` m, 0 where nothing was measured.

    Attributes:
        near_m, far_m: What is nearer is stored as 0; what is farther as `far_m` if `clip`, else
            as 0.
    """

    per_metre: int
    near_m: float
    far_m: float
    clip: bool

    def encode(self, depth_m: NDArray[np.float32]) -> NDArray[np.uint16]:
        """Return depth (...) [m] as it is stored."""
        valid = (depth_m > 0) & (depth_m >= self.near_m) & (self.clip | (depth_m <= self.far_m))
        scaled = np.rint(np.minimum(depth_m, np.float32(self.far_m)) * self.per_metre)
        return np.where(valid, scaled, 0).astype(np.uint16)

    def facts(self) -> dict[str, Any]:
        """Return what info.json says of it."""
        beyond = "depth_max_m" if self.clip else "invalid"
        limits = {"depth_min_m": self.near_m, "depth_max_m": self.far_m, "beyond": beyond}
        return {"is_depth_map": True, "depth_unit_m": 1 / self.per_metre, "invalid": 0, **limits}


@dataclass
class SceneWriter:
    """Writes the episodes of a scene one after the other.

    Attributes:
        episodes: Task, rows, end reason and further statistics of those written so far.
        features: What info.json says of columns and images.
    """

    out: Path
    depth: DepthFormat
    episodes: list[tuple[str, int, str, Mapping[str, Any]]] = field(default_factory=list)
    features: dict[str, Any] = field(default_factory=dict)

    def write_images(
        self,
        walk: Walk,
        shown: NDArray[np.int64],
        names: Sequence[str],
        chunk: str,
        suffix: str = "",
    ) -> Iterator[NDArray[np.float64]]:
        """Write images of the next episode; yield each depth [m] as a reader gets it."""
        size = [walk.camera.height_px, walk.camera.width_px]
        self.features |= {
            f"{RGB}{suffix}": {"dtype": "image", "shape": [*size, 3]},
            f"{DEPTH}{suffix}": {
                "dtype": "image",
                "shape": [*size, 1],
                "info": self.depth.facts(),
            },
        }
        rgb, depth = (
            folder_of(self.out / "videos" / chunk / f"{key}{suffix}") for key in (RGB, DEPTH)
        )
        walk.write_jpegs(shown, [rgb / f"{name}.jpg" for name in names])
        depth_m, images = walk.depth_codes(shown)
        stored = self.depth.encode(depth_m)
        read_m = stored / self.depth.per_metre
        for name, codes in zip(names, images, strict=True):
            write_png(depth / f"{name}.png", stored[codes])
            yield read_m[codes]

    def add(
        self,
        walk: Walk,
        task: str,
        columns: Mapping[str, NDArray[Any]],
        statistics: Mapping[str, Any],
        chunk: str,
    ) -> None:
        """Write the rows (N, …) of the next episode, as nested lists, and the scene's metadata."""
        path = self.out / "data" / chunk / f"episode_{len(self.episodes):06d}.parquet"
        folder_of(path.parent)
        arrays = [_nested(values) for values in columns.values()]
        pq.write_table(pa.Table.from_arrays(arrays, names=list(columns)), path)
        ending = str(walk.unit.columns["end_reason"])
        self.episodes.append((task, len(arrays[0]), ending, statistics))
        if len(self.episodes) == 1:
            self._write_info(walk, columns)

    def finish(self) -> None:
        """Write the lists of episodes."""
        meta, numbered = folder_of(self.out / "meta"), list(enumerate(self.episodes))
        lines = [
            {"episode_index": n, "tasks": [t], "length": k, "end_reason": e}
            for n, (t, k, e, _) in numbered
        ]
        write_lines(meta / "episodes.jsonl", lines)
        lines = [{"episode_index": n, **more, "stats": {}} for n, (*_, more) in numbered]
        write_lines(meta / "episodes_stats.jsonl", lines)
        tasks = enumerate(dict.fromkeys(task for task, *_ in self.episodes))
        write_lines(meta / "tasks.jsonl", ({"task_index": n, "task": t} for n, t in tasks))

    def _write_info(self, walk: Walk, columns: Mapping[str, NDArray[Any]]) -> None:
        self.features |= {
            name: {"dtype": str(values.dtype), "shape": list(values.shape[1:]) or [1]}
            for name, values in columns.items()
        }
        info = {
            "codebase_version": "v2.1",
            "robot_type": walk.unit.robot,
            "fps": walk.unit.frames_per_second,
            "features": self.features,
            "camera": walk.camera.to_json(),
        }
        text = json.dumps(info, indent=2) + "\n"
        (folder_of(self.out / "meta") / "info.json").write_text(text)


def _nested(values: NDArray[Any]) -> pa.Array:
    """Return values (N, …) as lists of lists: loaders take matrices apart row by row."""
    flat = pa.array(np.ascontiguousarray(values).reshape(-1))
    for size in values.shape[:0:-1]:
        flat = pa.FixedSizeListArray.from_arrays(flat, size)
    return flat
