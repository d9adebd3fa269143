"""The dataset card, README.md, with the metadata that the Hugging Face hub reads."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from .layout import DEPTH_KEY

# What a reader must know of each feature; frames and units are in the names in info.json.
MEANING = {
    "observation.images.rgb": "colour image",
    "observation.images.depth": "planar depth, 12-bit logarithmic video, 0 = invalid",
    "observation.state": "base pose in the start frame; velocities in the base frame",
    "observation.joints": "joint positions, then joint velocities",
    "observation.imu": "specific force and angular rate in the base frame",
    "observation.foot_contact": "1 where a foot touches, else 0",
    "observation.camera_pose": "pose of the camera's optical frame in the start frame",
    "observation.progress": "frame number over the last frame's",
    "action": "motion to the next frame, in this frame's yaw frame",
    "action.velocity": "velocity command at the frame",
    "action.discrete": "0 stop, 1 forward 0.25 m, 2 left 15°, 3 right 15°",
}


def dataset_card(
    title: str, licence: str, info: Mapping[str, Any], splits: Mapping[str, list[int]]
) -> str:
    """Return the card as Markdown with YAML front matter."""
    front = {
        "license": licence,
        "pretty_name": title,
        "task_categories": ["robotics"],
        "tags": ["LeRobot", "vision-and-language-navigation", str(info["robot_type"])],
        "configs": [{"config_name": "default", "data_files": "data/*/*.parquet"}],
    }
    # JSON values are valid YAML, and need no YAML library.
    header = "\n".join(
        f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in front.items()
    )
    rows = "\n".join(
        f"| `{key}` | {feature['dtype']} | {feature['shape']} | {MEANING[key]} |"
        for key, feature in info["features"].items()
        if key in MEANING
    )
    parts = "\n".join(f"| {name} | {len(episodes)} |" for name, episodes in splits.items())
    depth = info["features"][DEPTH_KEY]["info"]
    return f"""---
{header}
---

# {title}

Vision-and-Language Navigation, LeRobot {info["codebase_version"]}, robot `{info["robot_type"]}`:
{info["total_episodes"]} episodes, {info["total_frames"]} frames at {info["fps"]} frames/s,
{info["total_tasks"]} instructions. Made with vlnpe; `meta/provenance.json` says from what and how.

| split | episodes |
|---|---|
{parts}

`meta/splits.json` lists each split's episodes.

## Features

| feature | type | shape | meaning |
|---|---|---|---|
{rows}

- Start frame: the floor under the base at the first frame, z up, initial yaw 0.
- Frame t precedes `action[t]`; the last frame's action is STOP with zero motion.
- Depth is valid up to {depth["video.depth_max"]} m; readings invalid or out of range are 0.
- Episodes end as they ended: falls and failures are included. `end_reason` in `meta/episodes` tells
  which; only `success` is one. `action_discrete_derived` tells that `action.discrete` is the
  nearest action to the motion of a continuous controller and was not executed as such.
- `meta/episodes` also has scene, split, trajectory, all instructions, reference path, start and
  goal in the world, metrics, controller, light and camera intrinsics.
"""
