"""The dataset card, README.md, with the metadata that the Hugging Face hub reads."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..core.licences import hub_licence, licence_id
from .layout import DEPTH_KEY

FILM_STRIP = "film_strip.png"

# What a reader must know of each feature; frames and units are in the names in info.json.
MEANING = {
    "observation.images.rgb": "colour image",
    "observation.images.depth": "planar depth, 0 = invalid",
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
SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))


@dataclass(frozen=True)
class CardFacts:
    """What a card tells beyond info.json.

    Attributes:
        title: of the card.
        licence: identifier; the scenes' own ones, where the provenance knows them, go before it.
        splits: episodes of each published split.
        split_scenes: scenes of each published split.
        depth_far_m: readings beyond are 0.
        provenance: meta/provenance.json.
    """

    title: str
    licence: str
    splits: Mapping[str, list[int]]
    split_scenes: Mapping[str, set[str]]
    depth_far_m: float
    provenance: Mapping[str, Any]

    def scene_licences(self) -> dict[str, str]:
        """Licence identifier of each scene that the provenance knows."""
        scenes: Mapping[str, Any] = self.provenance.get("scenes") or {}
        return {
            name: licence_id(str(source.get("licence") or ""))
            for name, source in scenes.items()
            if isinstance(source, Mapping)
        }


def dataset_card(facts: CardFacts, info: Mapping[str, Any]) -> str:
    """Return the card as Markdown with YAML front matter; `info` is info.json."""
    robot, frames = info["robot_type"], info["total_frames"]
    licences = facts.scene_licences()
    front = {
        **hub_licence(licences.values() or [facts.licence]),
        "pretty_name": facts.title,
        "language": ["en"],
        "task_categories": ["robotics"],
        "size_categories": [next((name for most, name in SIZES if frames < most), "n>1M")],
        "tags": ["LeRobot", "vision-and-language-navigation", "vlnpe", str(robot)],
        "configs": [{"config_name": "default", "data_files": "data/*/*.parquet"}],
    }
    # JSON values are valid YAML, and need no YAML library.
    header = "\n".join(
        f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in front.items()
    )
    return f"""---
{header}
---

# {facts.title}

Vision-and-Language Navigation, LeRobot {info["codebase_version"]}, robot `{robot}`:
{info["total_episodes"]} episodes, {frames} frames at {info["fps"]} frames/s,
{info["total_tasks"]} instructions. Made with vlnpe; `meta/provenance.json` says from what and how.

![Frames of some episodes: colour, and depth beneath]({FILM_STRIP})

{_splits(facts)}

## Features

| feature | type | shape | meaning |
|---|---|---|---|
{_features(info)}

- Start frame: the floor under the base at the first frame, z up, initial yaw 0.
- Frame t precedes `action[t]`; the last frame's action is STOP with zero motion.
- Depth is valid up to {facts.depth_far_m} m; readings invalid or out of range are 0. {_depth(info)}
- Episodes end as they ended: falls and failures are included. `end_reason` in `meta/episodes` tells
  which; only `success` is one. `action_discrete_derived` tells that `action.discrete` is the
  nearest action to the motion of a continuous controller and was not executed as such.
- `meta/episodes` also has scene, split, trajectory, all instructions, reference path, start and
  goal in the world, metrics, controller, light and camera intrinsics.

## Licence

{_licences(facts, licences)}
"""


def _splits(facts: CardFacts) -> str:
    rows = [
        f"| {name} | {len(episodes)} | {len(facts.split_scenes[name])} |"
        for name, episodes in facts.splits.items()
    ]
    scenes = set().union(*facts.split_scenes.values())
    total = sum(map(len, facts.split_scenes.values()))
    if len(scenes) == 1:
        told = "All episodes lie in one scene, so none is held out to validate on unseen scenes."
    elif total == len(scenes):
        told = "No scene is in two splits."
    else:
        told = "Some scenes are in two splits, as the episodes' source has it."
    return "\n".join(
        [
            "| split | episodes | scenes |",
            "|---|---|---|",
            *rows,
            "",
            f"`meta/splits.json` lists each split's episodes. {told}",
        ]
    )


def _features(info: Mapping[str, Any]) -> str:
    return "\n".join(
        f"| `{key}` | {feature['dtype']} | {feature['shape']} | {MEANING[key]} |"
        for key, feature in info["features"].items()
        if key in MEANING
    )


def _depth(info: Mapping[str, Any]) -> str:
    if info["features"][DEPTH_KEY]["dtype"] == "image":
        return "Images hold whole millimetres."
    return "Videos hold 12-bit logarithmic codes, without further loss."


def _licences(facts: CardFacts, licences: Mapping[str, str]) -> str:
    if not licences:
        return f"`{facts.licence}`."
    scenes = facts.provenance["scenes"]
    return "\n".join(
        [
            "The images show these scenes and come under their licences; the full texts are in",
            "`meta/provenance.json`.",
            "",
            "| scene | licence | SHA-256 of the scan |",
            "|---|---|---|",
            *(
                f"| {name} | {licence} | `{str(scenes[name].get('sha256', ''))[:16]}` |"
                for name, licence in licences.items()
            ),
        ]
    )
