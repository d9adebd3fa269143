"""InternVLA-N1: discrete steps in LeRobot v2.1's shape, with camera poses and pixel goals."""

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
# Rigs are named by round numbers; a walking camera sways around them.
_HEIGHT_STEP_CM, _PITCH_STEP_DEG = 5, 5
_MEASURED = 20  # episodes


def write(out: Path, sources: Sequence[WalkSource], subset: Subset) -> Written:
    """Write the episodes of one scene."""
    setting, measured = _setting([Walk.open(source) for source in sources[:_MEASURED]])
    scene = SceneWriter(out, MILLIMETRES, f".{setting}")
    frames: list[NDArray[np.int64] | None] = []
    kinds: list[str] = []
    goals = 0
    for source in sources:
        walk, number = Walk.open(source), len(scene.episodes)
        steps = walk.steps()
        if len(steps.action) < SHORTEST:
            frames.append(None)
            continue
        chunk = f"chunk-{number // EPISODES_PER_CHUNK:03d}"
        names = [f"episode_{number:06d}_{k}" for k in range(len(steps.frame))]
        poses = walk.camera_poses()[steps.frame]
        pixels, ahead = pixel_goals(
            walk.camera,
            poses,
            walk.floor_points()[steps.frame],
            scene.write_images(walk, steps.frame, names, chunk),
            MILLIMETRES.far_m,
        )
        columns = {
            "action": np.array([START, *steps.action[:-1]], np.int64),
            f"pose.{setting}": poses,
            f"goal.{setting}": pixels,
            f"relative_goal_frame_id.{setting}": ahead,
        }
        scene.add(walk, SEPARATOR.join(source.texts), columns, {}, chunk)
        frames.append(steps.frame)
        kinds += [KIND_OF[a] for a in steps.action.tolist()] * len(source.texts)
        goals += int((ahead != NONE).sum())
    scene.finish()
    facts = (
        f"rig `{setting}`: {measured}",
        f"{goals} of {sum(length for _, length, *_ in scene.episodes)} steps have a pixel goal",
        "depth: uint16 PNG in millimetres, clipped at 5 m, 0 = not measured",
        "poses: camera in the world, x right, y down, z forward, metres",
    )
    counts = Counter(kinds)
    return Written(frames, len(scene.episodes), counts, counts, facts)


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


INTERNVLA_N1 = Layout(
    "internvla-n1", "InternVLA-N1", write, per_scene=True, depth=True, endings=True
)
