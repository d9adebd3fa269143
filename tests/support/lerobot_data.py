"""Datasets of made-up episodes, by our writer and by LeRobot's own."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tests.support.rollouts import make_frames, make_images, make_rollout
from vlnpe.formats.core.camera import CameraModel, DepthRange
from vlnpe.formats.core.rollout import Rollout
from vlnpe.formats.lerobot import write_episode_unit
from vlnpe.formats.rendered.folder import FrameFolder
from vlnpe.formats.rendered.image_counts import new_depth_counts, new_rgb_counts
from vlnpe.formats.rendered.table import build_frame_table
from vlnpe.formats.video.codecs import DEPTH_CODEC, RGB_CODECS
from vlnpe.formats.video.depth_codes import codes_to_millimetres, depth_to_codes
from vlnpe.formats.video.depth_images import write_depth_images
from vlnpe.formats.video.mp4 import write_depth_video, write_rgb_video

RGB, DEPTH = "observation.images.rgb", "observation.images.depth"
RANGE = DepthRange(0.05, 20.0)
CAMERA = CameraModel("front", 96, 64, 90.0)


def write_unit(
    root: Path,
    rollout: Rollout,
    number: int = 0,
    frames_per_second: int = 4,
    *,
    counted: bool = True,
    images: tuple[np.ndarray, np.ndarray] | None = None,
    depth_storage: str = "video",
    rgb_codec: str = "h264",
    camera_name: str = "front",
    hfov_deg: float = 90.0,
    rendered_as: str = "video",
    units: Path | None = None,
) -> Path:
    """Encode images in `root` and write `unit-<number>` there, or in the folder `units`."""
    frames: dict[str, Any] = make_frames(rollout, frames_per_second)
    rgb, depth = images or make_images(len(frames["sample_index"]), number)
    rgb_counts, depth_counts = new_rgb_counts(), new_depth_counts()
    suffix, write_depth = {
        "video": ("mp4", write_depth_video),
        "image": ("mov", write_depth_images),
    }[rendered_as]
    rgb_path, depth_path = root / f"rgb-{number}.mp4", root / f"depth-{number}.{suffix}"
    write_rgb_video(rgb_path, rgb, frames_per_second, rgb_codec, counts=rgb_counts)
    write_depth(depth_path, depth, frames_per_second, RANGE, counts=depth_counts)
    if counted:
        frames |= {"rgb_counts": rgb_counts, "depth_counts": depth_counts}
    camera = CameraModel(camera_name, rgb.shape[2], rgb.shape[1], hfov_deg)
    folder = (units or root) / f"unit-{number}"
    seen = FrameFolder(
        rgb_video=rgb_path,
        depth_video=depth_path,
        arrays=frames,
        camera=camera,
        depth_range=RANGE,
        frames_per_second=frames_per_second,
        light="baked",
        rgb_codec=rgb_codec,
        facts={},
    )
    write_episode_unit(folder, rollout, seen, depth_storage=depth_storage)
    return folder


def load(root: Path, **options: Any) -> Any:
    """Open a dataset with LeRobot."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    return LeRobotDataset("vlnpe/test", root=root, **options)


def assert_same_schemas(ours: Path, reference: Path) -> None:
    """Assert that two datasets have the same info.json and types of rows; we have more columns."""
    roots = (ours, reference)
    rows = [pq.read_schema(root / "data/chunk-000/file-000.parquet") for root in roots]
    assert rows[0].equals(rows[1])
    hub = [json.loads((schema.metadata or {})[b"huggingface"])["info"] for schema in rows]
    assert hub[0] == hub[1]
    infos = [json.loads((root / "meta/info.json").read_text()) for root in roots]
    assert infos[0] == infos[1]
    episodes = [pq.read_schema(root / "meta/episodes/chunk-000/file-000.parquet") for root in roots]
    assert episodes[0].names[: len(episodes[1])] == episodes[1].names


def write_units(
    root: Path,
    seconds: Sequence[float],
    frames_per_second: int = 4,
    depth_storage: str = "video",
    rgb_codec: str = "h264",
) -> list[Path]:
    """Episodes of given lengths; every second executes discrete actions, the last falls."""
    return [
        write_unit(
            root,
            make_rollout(s, n, discrete=n % 2 == 1, fall=n == len(seconds) - 1),
            n,
            frames_per_second,
            depth_storage=depth_storage,
            rgb_codec=rgb_codec,
        )
        for n, s in enumerate(seconds)
    ]


def write_reference(
    root: Path, seconds: Sequence[float], frames_per_second: int = 4, depth_storage: str = "video"
) -> None:
    """Write the dataset of `write_units` with LeRobot's own writer and the same encoders."""
    from lerobot.configs import DepthEncoderConfig, RGBEncoderConfig
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    dataset = None
    for n, length in enumerate(seconds):
        rollout = make_rollout(length, n, discrete=n % 2 == 1, fall=n == len(seconds) - 1)
        table = build_frame_table(
            rollout, make_frames(rollout, frames_per_second), frames_per_second
        )
        rgb, depth = make_images(len(table), n)
        if dataset is None:
            features: dict[str, Any] = {
                key: {
                    "dtype": str(values.dtype),
                    "shape": (values.shape[1],),
                    "names": table.column_names[key],
                }
                for key, values in table.columns.items()
            }
            names = ["height", "width", "channels"]
            shape = rgb.shape[1:3]
            features["observation.images.rgb"] = {
                "dtype": "video",
                "shape": (*shape, 3),
                "names": names,
            }
            features["observation.images.depth"] = {
                "dtype": depth_storage,
                "shape": (*shape, 1),
                "names": names,
                "info": {"is_depth_map": True},
            }
            h264 = RGB_CODECS["h264"]
            dataset = LeRobotDataset.create(
                "vlnpe/reference",
                frames_per_second,
                features,
                root=root,
                robot_type="aliengo",
                rgb_encoder=RGBEncoderConfig(
                    vcodec="h264",
                    crf=h264.crf,
                    preset=h264.preset,
                    extra_options=dict(h264.extra_options),
                ),
                depth_encoder=DepthEncoderConfig(
                    depth_min=0.0,
                    depth_max=RANGE.far_m,
                    preset=DEPTH_CODEC.preset,
                    extra_options=dict(DEPTH_CODEC.extra_options),
                ),
            )
        for i in range(len(table)):
            frame = {key: values[i] for key, values in table.columns.items()}
            frame["observation.images.rgb"] = rgb[i]
            frame["observation.images.depth"] = stored(depth[i], depth_storage)[..., None]
            dataset.add_frame(frame | {"task": rollout.episode.instruction})
        dataset.save_episode(parallel_encoding=False)
    assert dataset is not None
    dataset.finalize()


def stored(depth_m: np.ndarray, depth_storage: str) -> np.ndarray:
    """What an image of whole millimetres holds of a depth image that is kept as codes before."""
    if depth_storage == "video":
        return depth_m
    return codes_to_millimetres(depth_to_codes(depth_m, RANGE), RANGE)


def write_foreign_dataset(root: Path, version: object = "v2.1") -> Path:
    """Write a LeRobot dataset as others publish them: an arm, one frame, no camera."""
    number = {"dtype": "float32", "shape": [1], "names": None}
    info = {
        "codebase_version": version,
        "robot_type": "so101",
        "fps": 30,
        "features": {"observation.state": number, "action": number},
    }
    tables = root / "data" / "chunk-000"
    tables.mkdir(parents=True)
    pq.write_table(pa.table({"action": [0.0]}), tables / "episode_000000.parquet")
    (root / "meta").mkdir()
    for name, line in (
        ("info.json", info),
        ("tasks.jsonl", {"task_index": 0, "task": "pick"}),
        ("episodes.jsonl", {"episode_index": 0, "tasks": ["pick"], "length": 1}),
    ):
        (root / "meta" / name).write_text(json.dumps(line))
    return root
