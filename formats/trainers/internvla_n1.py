"""InternVLA-N1: discrete steps in LeRobot v2.1's shape, with camera poses and pixel goals."""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .answers import KIND_OF
from .lerobot21 import DepthFormat, SceneWriter
from .pixel_goals import NONE, pixel_goals
from .streamvln import SHORTEST, START
from .subset import Layout, Subset, Written
from .walks import Walk, WalkSource

SEPARATOR = "<INSTRUCTION_SEP>"
MILLIMETRES = DepthFormat(1000, 0.0, 5.0, clip=True)
EPISODES_PER_CHUNK = 1000
_RIG = re.compile(r"rig:([^:]+)")
# A robot's own camera is named by round numbers, around which it sways.
_HEIGHT_STEP_CM, _PITCH_STEP_DEG = 5, 5
_MEASURED = 20  # episodes


def write(out: Path, sources: Sequence[WalkSource], subset: Subset) -> Written:
    """Write the episodes of one scene, each with the views of all its rigs."""
    rigs = _rigs(sources[:_MEASURED])
    scene = SceneWriter(out, MILLIMETRES)
    frames: list[NDArray[np.int64] | None] = []
    kinds: list[str] = []
    goals: Counter[str] = Counter()
    for source in sources:
        views, number = Walk.open_all(source), len(scene.episodes)
        steps = views[0].steps()
        if len(steps.action) < SHORTEST:
            frames.append(None)
            continue
        chunk = f"chunk-{number // EPISODES_PER_CHUNK:03d}"
        names = [f"episode_{number:06d}_{k}" for k in range(len(steps.frame))]
        floor = views[0].floor_points()[steps.frame]
        columns = {"action": np.array([START, *steps.action[:-1]], np.int64)}
        for rig, walk in zip(rigs, views, strict=True):
            poses = walk.camera_poses()[steps.frame]
            depths = scene.write_images(walk, steps.frame, names, chunk, f".{rig}")
            pixels, ahead = pixel_goals(walk.camera, poses, floor, depths, MILLIMETRES.far_m)
            columns |= {
                f"pose.{rig}": poses,
                f"goal.{rig}": pixels,
                f"relative_goal_frame_id.{rig}": ahead,
            }
            goals[rig] += int((ahead != NONE).sum())
        scene.add(views[0], SEPARATOR.join(source.texts), columns, {}, chunk)
        frames.append(steps.frame)
        kinds += [KIND_OF[a] for a in steps.action.tolist()] * len(source.texts)
    scene.finish()
    count = sum(length for _, length, *_ in scene.episodes)
    facts = (
        *(
            f"rig `{rig}`: {measured}; {goals[rig]} of {count} steps have a pixel goal"
            for rig, measured in rigs.items()
        ),
        "depth: uint16 PNG in millimetres, clipped at 5 m, 0 = not measured",
        "poses: camera in the world, x right, y down, z forward, metres",
    )
    counts = Counter(kinds)
    return Written(frames, len(scene.episodes), counts, counts, facts)


def _rigs(sources: Sequence[WalkSource]) -> dict[str, str]:
    """Return what was measured of each rig, by its name in the layout."""
    rigs = {}
    for walks in zip(*map(Walk.open_all, sources), strict=True):
        poses = np.concatenate([walk.camera_poses() for walk in walks])
        floor = np.concatenate([walk.floor_points() for walk in walks])
        height_cm = 100 * float(np.median(poses[:, 2, 3] - floor[:, 2]))
        pitch_deg = float(np.median(np.rad2deg(-np.arcsin(np.clip(poses[:, 2, 2], -1, 1)))))
        height = _HEIGHT_STEP_CM * round(height_cm / _HEIGHT_STEP_CM)
        pitch = _PITCH_STEP_DEG * round(pitch_deg / _PITCH_STEP_DEG)
        named = _RIG.match(walks[0].camera.name)
        rigs[named[1] if named else f"{height}cm_{pitch}deg"] = (
            f"the camera's median height is {height_cm:.1f} cm, pitched {pitch_deg:.1f}° down"
        )
    return rigs


INTERNVLA_N1 = Layout(
    "internvla-n1", "InternVLA-N1", write, per_scene=True, depth=True, endings=True, rigs=True
)
