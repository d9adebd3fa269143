"""InternVLA-N1: discrete steps in LeRobot v2.1's shape, with camera poses and pixel goals."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import lerobot21
from .answers import KIND_OF, Histogram
from .pixel_goals import NONE, pixel_goals
from .streamvln import SHORTEST, START
from .subset import Layout, Subset, Written, folder_of
from .walks import Walk, WalkSource, stored_depth, write_depth_png

SEPARATOR = "<INSTRUCTION_SEP>"
PER_METRE, FAR_M = 1000, 5.0
EPISODES_PER_CHUNK = 1000
# Rigs are named by round numbers; a walking camera sways around them.
_HEIGHT_STEP_CM, _PITCH_STEP_DEG = 5, 5


def write(out: Path, sources: Sequence[WalkSource], subset: Subset) -> Written:
    """Write the episodes of one scene."""
    setting, measured = _setting([Walk.open(source) for source in sources[:20]])
    frames: list[NDArray[np.int64] | None] = []
    kinds: list[str] = []
    episodes: list[tuple[str, int]] = []
    statistics: list[dict[str, Any]] = []
    features: dict[str, Any] = {}
    for source in sources:
        walk, number = Walk.open(source), len(episodes)
        steps = walk.steps()
        if len(steps.action) < SHORTEST:
            frames.append(None)
            continue
        chunk = f"chunk-{number // EPISODES_PER_CHUNK:03d}"
        folders = [
            folder_of(out / "videos" / chunk / f"{key}.{setting}")
            for key in (lerobot21.RGB, lerobot21.DEPTH)
        ]
        names = [f"episode_{number:06d}_{k}" for k in range(len(steps.frame))]
        walk.write_jpegs(steps.frame, [folders[0] / f"{name}.jpg" for name in names])
        poses = walk.camera_poses()[steps.frame]
        goals = pixel_goals(
            walk.camera,
            poses,
            walk.floor_points()[steps.frame],
            _written_depths(walk, steps.frame, [folders[1] / f"{name}.png" for name in names]),
            FAR_M,
        )
        columns = {
            "action": np.array([START, *steps.action[:-1]], np.int64),
            f"pose.{setting}": poses,
            f"goal.{setting}": goals[0],
            f"relative_goal_frame_id.{setting}": goals[1],
        }
        lerobot21.write_table(out / "data" / chunk / f"episode_{number:06d}.parquet", columns)
        features = lerobot21.column_features(columns)
        features |= lerobot21.picture_features(
            walk, f".{setting}", PER_METRE, (0.0, FAR_M), "stored as depth_max_m"
        )
        frames.append(steps.frame)
        kinds += [KIND_OF[a] for a in steps.action.tolist()] * len(source.texts)
        episodes.append((SEPARATOR.join(source.texts), len(steps.action)))
        seen = int((goals[1] != NONE).sum())
        statistics.append({"episode_index": number, "stats": {}, "pixel_goals": seen})
    if episodes:
        lerobot21.write_meta(out, Walk.open(sources[0]), episodes, features, statistics)
    goals_seen = sum(line["pixel_goals"] for line in statistics)
    steps_all = sum(length for _, length in episodes)
    facts = (
        f"setting `{setting}`: {measured}",
        f"pixel goals: {goals_seen} of {steps_all} steps have one, [column, row], checked against "
        "depth; −1 where the camera sees no later point of the walk within 5 m",
        "depth: uint16 PNG in millimetres, clipped at 5 m, 0 = not measured",
        "poses: camera in the world, 4 × 4, x right, y down, z forward, metres, z of the world up",
    )
    return Written(frames, len(episodes), Histogram.of(kinds), facts)


def _written_depths(
    walk: Walk, frames: NDArray[np.int64], paths: Sequence[Path]
) -> Iterator[NDArray[np.float64]]:
    """Write depth images; yield what a reader gets of each [m]."""
    for path, depth in zip(paths, walk.depths_m(frames), strict=True):
        stored = stored_depth(depth, PER_METRE, 0.0, FAR_M, clip=True)
        write_depth_png(path, stored)
        yield stored / PER_METRE


def _setting(walks: Sequence[Walk]) -> tuple[str, str]:
    """Return the rig's name in the layout, and what was measured."""
    poses = np.concatenate([walk.camera_poses() for walk in walks])
    floor = np.concatenate([walk.floor_points() for walk in walks])
    height_cm = 100 * float(np.median(poses[:, 2, 3] - floor[:, 2]))
    pitch_deg = float(np.median(np.rad2deg(-np.arcsin(np.clip(poses[:, 2, 2], -1, 1)))))
    height = _HEIGHT_STEP_CM * round(height_cm / _HEIGHT_STEP_CM)
    pitch = _PITCH_STEP_DEG * round(pitch_deg / _PITCH_STEP_DEG)
    measured = f"the camera's median height is {height_cm:.1f} cm, pitched {pitch_deg:.1f}° down"
    return f"{height}cm_{pitch}deg", measured


INTERNVLA_N1 = Layout("internvla-n1", "InternVLA-N1", write, per_scene=True, depth=True)
