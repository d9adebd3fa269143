"""The dataset card, README.md, with the metadata that the Hugging Face hub reads."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.arrays import Floats
from ..core.camera import CameraModel
from ..core.frames import quat_to_matrix
from ..core.licences import hub_licence, licence_id
from ..scene import UNSOUND
from ..video.depth_codes import SHIFT_M
from .layout import DEPTH_KEY
from .usage import POLICIES, loading_code, training_command

FILM_STRIP = "film_strip.png"

# Meaning of each feature for readers; frames and units are in the names in info.json.
MEANING = {
    "observation.images.rgb": "colour image",
    "observation.images.depth": "planar depth, 0 = invalid",
    "observation.state": "base pose in the start frame; velocities in the base frame",
    "observation.joints": "joint positions, then joint velocities",
    "observation.imu": "specific force and angular rate in the base frame",
    "observation.foot_contact": "1 where a foot touches, else 0",
    "observation.foot_force": "normal force of the ground on each foot",
    "observation.camera_pose": "pose of the camera's optical frame in the start frame",
    "observation.progress": "frame number over the last frame's",
    "action": "motion to the next frame, in this frame's yaw frame",
    "action.velocity": "velocity command at the frame",
    "action.discrete": "0 stop, 1 forward 0.25 m, 2 left 15°, 3 right 15° (the expert here)",
    "action.executed": "the same, as executed by a policy and the expert (DAgger)",
}
REPO = "user/name"  # a card does not know where it will be published
SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))


@dataclass(frozen=True)
class CameraFacts:
    """The view that a dataset's images show.

    Attributes:
        height_m: (lowest, median, highest) above the floor at the episode's start.
        pitch_down_deg: (lowest, median, highest).
    """

    camera: CameraModel
    height_m: tuple[float, float, float]
    pitch_down_deg: tuple[float, float, float]

    @staticmethod
    def of(camera: CameraModel, camera_pose: Floats) -> "CameraFacts":
        """Return the facts of the poses (N, 7), position [m] and quat_wxyz in the start frame."""
        forward_z = quat_to_matrix(camera_pose[:, 3:].astype(np.float64))[:, 2, 2]
        pitch = np.rad2deg(np.arcsin(np.clip(-forward_z, -1.0, 1.0)))
        return CameraFacts(camera, _spread(camera_pose[:, 2]), _spread(pitch))


@dataclass(frozen=True)
class CardFacts:
    """Facts of a card beyond info.json.

    Attributes:
        licence: identifier; the scenes' own ones, where the provenance knows them, go before it.
        splits: episodes of each published split.
        split_scenes: scenes of each published split.
        depth_far_m: readings beyond are 0.
        provenance: meta/provenance.json.
        instructions: distinct instructions of all episodes; an episode may have several, of which
            one is its task.
    """

    title: str
    licence: str
    splits: Mapping[str, list[int]]
    split_scenes: Mapping[str, set[str]]
    depth_far_m: float
    camera: CameraFacts
    provenance: Mapping[str, Any]
    instructions: int

    def scenes(self) -> dict[str, Mapping[str, Any]]:
        """Return the facts of the source of each scene that the provenance knows."""
        scenes: Mapping[str, Any] = self.provenance.get("scenes") or {}
        return {name: facts for name, facts in scenes.items() if isinstance(facts, Mapping)}

    def scene_licences(self) -> dict[str, str]:
        """Return the licence identifier of each scene that the provenance knows."""
        return {k: licence_id(str(v.get("licence") or "")) for k, v in self.scenes().items()}


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
{_instructions(facts, info)}. Made with vlnpe; `meta/provenance.json` says from what and how.

![Frames of some episodes: colour, and depth beneath]({FILM_STRIP})

Depth in the picture has the scale beside it in metres; grey: not measured.

{_splits(facts)}

## Use it

With LeRobot 0.6 (`pip install "lerobot[dataset,diffusion]==0.6.1"`):

```python
{loading_code(REPO)}```

Train ACT on colours and state, or the diffusion policy with `--policy.type={POLICIES[1]}`; no
weights are fetched:

```sh
{training_command(REPO, info["features"])}```

`StreamingLeRobotDataset` decodes with torchcodec alone, which needs FFmpeg's libraries.

## Features

| feature | type | shape | meaning |
|---|---|---|---|
{_features(info)}

- Start frame: the floor under the base at the first frame, z up, initial yaw 0.
- Frame t precedes `action[t]`; the last frame's action is STOP with zero motion.
{_depth(info, facts.depth_far_m)}- {_camera(facts.camera)}
- Episodes end as they ended: falls and failures are included. `end_reason` in `meta/episodes` tells
  which; only `success` is one. `action.discrete` is what a VLN-CE expert would do at each
  pose; `action_discrete_derived` tells that it was not executed, for the controller is continuous.
  To train on steps of 0.25 m and 15° that lead along the robot's path, take discrete steps
  (`discrete_steps(planar_poses(states))` of `vlnpe.formats.rendered.discrete_steps`, as
  `EpisodeSequences` does), not each frame's label; see vlnpe's `docs/reference/data.md`, section
  "Discrete actions".
- `meta/episodes` also has scene, split, trajectory, all instructions, reference path, start and
  goal in the world, metrics, controller, light and camera intrinsics.

{_unsound(facts)}## Licence

{_licences(facts, licences)}
"""


def _instructions(facts: CardFacts, info: Mapping[str, Any]) -> str:
    count, tasks = facts.instructions, info["total_tasks"]
    if count <= tasks:
        return f"{count} instructions"
    return f"{count} instructions, {tasks} of them as tasks (`meta/episodes` holds all)"


def _camera(facts: CameraFacts) -> str:
    camera = facts.camera
    (fx, _, cx), (_, _, cy), _ = camera.intrinsics.tolist()
    spreads = ((facts.height_m, 2, " m"), (facts.pitch_down_deg, 0, "°"))
    height, pitch = (
        f"{middle:.{digits}f}{unit} ({low:.{digits}f} … {high:.{digits}f})"
        for (low, middle, high), digits, unit in spreads
    )
    return f"""Camera `{camera.name}`: {camera.width_px} × {camera.height_px} px, HFOV \
{camera.hfov_deg:g}°, fx = fy = {fx:.3f}, cx = {cx:g}, cy = {cy:g}.
  Height over the floor at the start {height}, pitched down {pitch}: medians, and 1st to
  99th percentile; the pose of each frame is `observation.camera_pose`.
- Pixels follow OpenCV's convention, the centre of the first pixel is (0, 0): column u and row v
  with depth z are the point ((u − cx) z / fx, (v − cy) z / fy, z) of the optical frame (x right,
  y down, z forward)."""


def _spread(values: Floats) -> tuple[float, float, float]:
    low, middle, high = np.quantile(values, (0.01, 0.5, 0.99)).tolist()
    return low, middle, high


def _unsound(facts: CardFacts) -> str:
    """Return the section about unsound scenes and their faults; empty without any."""
    lines = [
        f"- `{name}`: {problem}"
        for name, source in sorted(facts.scenes().items())
        for problem in source.get(UNSOUND, ())
    ]
    if not lines:
        return ""
    statement = "Collected with `--allow-unsound` in scenes whose repaired floor has faults:"
    return "\n".join(["## Unsound scenes", "", statement, "", *lines, "", ""])


def _splits(facts: CardFacts) -> str:
    rows = [
        f"| {name} | {len(episodes)} | {len(facts.split_scenes[name])} |"
        for name, episodes in facts.splits.items()
    ]
    scenes = set().union(*facts.split_scenes.values())
    total = sum(map(len, facts.split_scenes.values()))
    if len(scenes) == 1:
        statement = (
            "All episodes lie in one scene, so none is held out to validate on unseen scenes."
        )
    elif total == len(scenes):
        statement = "No scene is in two splits."
    else:
        statement = "Some scenes are in two splits, as the episodes' source has it."
    note = f"`meta/splits.json` lists each split's episodes. {statement}"
    return "\n".join(["| split | episodes | scenes |", "|---|---|---|", *rows, "", note])


def _features(info: Mapping[str, Any]) -> str:
    return "\n".join(
        f"| `{key}` | {feature['dtype']} | {feature['shape']} | {MEANING[key]} |"
        for key, feature in info["features"].items()
        if key in MEANING
    )


def _depth(info: Mapping[str, Any], far_m: float) -> str:
    """Return the line on depth; empty for a dataset whose depth LeRobot's tools removed."""
    depth = info["features"].get(DEPTH_KEY)
    if depth is None:
        return ""
    stored = "Images hold whole millimetres."
    if depth["dtype"] != "image":
        stored = (
            "Videos hold 12-bit codes c without further loss: z = s ((f + s) / s)^(c / 4095) − s\n"
            f"  with s = {SHIFT_M} m and f = {depth['info']['video.depth_max']} m. "
            "Readers that give 8 bits in silence (decord, OpenCV, torchvision)\n"
            "  lose up to 16 cm: read `gray12le`, e.g. with PyAV."
        )
    return f"""\
- Depth is planar z (along the optical axis), valid up to {far_m} m; readings invalid or
  out of range are 0. {stored} LeRobot returns millimetres unless it is opened with
  `depth_output_unit="m"`.
"""


def _licences(facts: CardFacts, licences: Mapping[str, str]) -> str:
    if not licences:
        return f"`{facts.licence}`."
    rows = "\n".join(
        f"| {name} | {licences[name]} | `{str(source.get('sha256', ''))[:16]}` |"
        for name, source in facts.scenes().items()
    )
    return f"""\
The images show these scenes and come under their licences; the full texts are in
`meta/provenance.json`.

| scene | licence | SHA-256 of the scan |
|---|---|---|
{rows}"""
