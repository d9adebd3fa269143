"""Walks over a level floor between walls, with the depth that a camera really has there."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tests.support.lerobot_data import write_unit
from tests.support.rollouts import make_frames, make_images, make_rollout
from vlnpe.formats.core.camera import CameraModel
from vlnpe.formats.core.frames import quat_to_matrix
from vlnpe.formats.core.rollout import EndReason, Rollout
from vlnpe.formats.trainers.walks import WalkSource

CAMERA = CameraModel("front", 96, 64, 90.0)
WALLS_M = 3.5  # half the side of the room


def make_walk(number: int = 0, seconds: float = 12.0, **changes: Any) -> Rollout:
    rollout = make_rollout(seconds, number)
    episode = replace(rollout.episode, level=0, **changes.pop("episode", {}))
    return replace(rollout, episode=episode, **changes)


def true_depth(rollout: Rollout, rate: int = 4) -> np.ndarray:
    """Planar depth (N, H, W) [m] of the floor and of walls around the walk's middle."""
    frames = make_frames(rollout, rate)
    rays = CAMERA.pixel_rays()
    middle = rollout.position_world_m[:, :2].mean(axis=0)
    images = []
    for at, quat in zip(frames["camera_position_world_m"], frames["camera_quat_wxyz"], strict=True):
        ways = rays @ quat_to_matrix(quat).T
        with np.errstate(divide="ignore", invalid="ignore"):
            floor = (rollout.floor_z_m[0] - at[2]) / ways[..., 2]
            sides = [
                (middle[k] + sign * WALLS_M - at[k]) / ways[..., k]
                for k in (0, 1)
                for sign in (1, -1)
            ]
        hits = np.stack([np.where(z > 0, z, np.inf) for z in (floor, *sides)])
        images.append(hits.min(axis=0))
    return np.stack(images).astype(np.float32)


def make_unit(
    root: Path, number: int = 0, rate: int = 4, camera_name: str = "front", **changes: Any
) -> Path:
    rollout = make_walk(number, **changes)
    depth = true_depth(rollout, rate)
    rgb = make_images(len(depth), number)[0]
    return write_unit(root, rollout, number, rate, images=(rgb, depth), camera_name=camera_name)


def make_sources(root: Path) -> list[WalkSource]:
    """Three walks, the second with one text only."""
    texts = (("Walk on.", "Go to the sofa."), ("Stop by the sofa.",), ("Turn. Then stop.", "Go!"))
    return [
        WalkSource(make_unit(root, k, seconds=8.0 + 3 * k), f"room_dog_{k:06d}", own)
        for k, own in enumerate(texts)
    ]


FALLEN: dict[str, Any] = {"end_reason": EndReason.FALL}
