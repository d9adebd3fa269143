"""Code that loads and trains on a dataset with LeRobot: the text of cards, run by the tests."""

import json
from collections.abc import Mapping
from typing import Any

from .layout import RGB_KEY

# LeRobot's ACT and diffusion policies take colour images and a state; depth among them makes ACT
# fail.
INPUTS = {RGB_KEY: "VISUAL", "observation.state": "STATE"}
OUTPUTS = {"action": "ACTION"}
POLICIES = ("act", "diffusion")


def loading_code(repo: str) -> str:
    """Return Python code that opens the dataset `repo` of the hub with LeRobot."""
    return f"""\
from lerobot.datasets.lerobot_dataset import LeRobotDataset

# Depth in metres (LeRobot's own default is millimetres), decoded by PyAV (torchcodec needs FFmpeg).
dataset = LeRobotDataset("{repo}", depth_output_unit="m", video_backend="pyav")
frame = dataset[0]
"""


def training_command(repo: str, features: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the shell command that trains ACT on the dataset `repo` (`user/name` on the hub).

    `features` are entries of info.json. Nothing but the dataset is fetched: the image backbone
    starts without pretrained weights.
    """
    inputs = {key: _policy_feature(features[key], kind) for key, kind in INPUTS.items()}
    outputs = {key: _policy_feature(features[key], kind) for key, kind in OUTPUTS.items()}
    lines = [
        f"lerobot-train --dataset.repo_id={repo} --dataset.video_backend=pyav",
        f"--policy.type={POLICIES[0]} --policy.pretrained_backbone_weights=null",
        f"--policy.input_features='{json.dumps(inputs)}'",
        f"--policy.output_features='{json.dumps(outputs)}'",
        "--policy.push_to_hub=false --output_dir=outputs/policy",
    ]
    return " \\\n  ".join(lines) + "\n"


def _policy_feature(feature: Mapping[str, Any], kind: str) -> dict[str, Any]:
    shape = list(feature["shape"])
    # Images lie as (H, W, C) in files and come as (C, H, W) from the loader.
    return {"type": kind, "shape": [shape[2], *shape[:2]] if kind == "VISUAL" else shape}
