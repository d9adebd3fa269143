"""Depth kept as 16-bit images: equal to what LeRobot's own writer makes of the same frames."""

import io
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.lerobot_data import (
    DEPTH,
    RANGE,
    RGB,
    assert_same_schemas,
    load,
    stored,
    write_reference,
    write_unit,
    write_units,
)
from tests.support.rollouts import make_images, make_rollout
from vlnpe.datasets.episode_index import read_index
from vlnpe.datasets.episode_reader import EpisodeReader
from vlnpe.formats.core.atomic import sweep_beside
from vlnpe.formats.core.errors import FileFormatError, UnknownNameError
from vlnpe.formats.lerobot import FileLimits, assemble_dataset, read_episode_unit
from vlnpe.formats.video.depth_codes import decode_depth_tiff, encode_depth_tiff
from vlnpe.formats.video.depth_images import write_depth_images
from vlnpe.formats.video.mp4 import write_depth_video

pytestmark = pytest.mark.usefixtures("offline")
SECONDS = (3.0, 0.0, 1.5)
DATA = "data/chunk-000/file-000.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
ASSEMBLY: dict[str, Any] = {"provenance": {}, "licence": "mit", "title": "Two rooms"}


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ours")
    units = write_units(folder, SECONDS, depth_storage="image")
    assemble_dataset(units, folder / "set", **ASSEMBLY)
    return folder / "set"


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("reference") / "set"
    write_reference(root, SECONDS, depth_storage="image")
    return root


def test_schemas_and_info_equal_lerobots(ours: Path, reference: Path) -> None:
    assert_same_schemas(ours, reference)
    assert not (ours / "videos" / DEPTH).exists()


def test_rows_equal_lerobots_and_images_to_the_millimetre(ours: Path, reference: Path) -> None:
    from PIL import Image

    our_table, theirs = pq.read_table(ours / DATA), pq.read_table(reference / DATA)
    assert our_table.drop([DEPTH]).equals(theirs.drop([DEPTH]))
    for a, b in zip(our_table[DEPTH].to_pylist(), theirs[DEPTH].to_pylist(), strict=True):
        assert a["path"] == b["path"]
        images = [Image.open(io.BytesIO(row["bytes"])) for row in (a, b)]
        assert images[0].mode == images[1].mode == "I;16"
        np.testing.assert_array_equal(np.array(images[0]), np.array(images[1]))


def test_statistics_equal_lerobots(ours: Path, reference: Path) -> None:
    our_stats, theirs = (json.loads((p / "meta/stats.json").read_text()) for p in (ours, reference))
    assert list(our_stats[DEPTH]) == list(theirs[DEPTH])
    for name, value in theirs[DEPTH].items():
        # Of values up to 65,535 mm LeRobot's histogram has bins of some millimetres.
        np.testing.assert_allclose(our_stats[DEPTH][name], value, atol=3.0, err_msg=name)
    np.testing.assert_allclose(our_stats[DEPTH]["mean"], theirs[DEPTH]["mean"], rtol=1e-6)
    rows = [pq.read_table(p / EPISODES) for p in (ours, reference)]
    for name in ("min", "max", "mean", "std", "q50", "count"):
        key = f"stats/{DEPTH}/{name}"
        for a, b in zip(*(table[key].to_pylist() for table in rows), strict=True):
            np.testing.assert_allclose(a, b, atol=3.0, err_msg=key)


@pytest.mark.parametrize("unit", ["m", "mm"])
def test_loaded_frames_equal_lerobots(ours: Path, reference: Path, unit: str) -> None:
    our_data, theirs = (load(p, depth_output_unit=unit) for p in (ours, reference))
    assert len(our_data) == len(theirs) == 13 + 1 + 7
    for i in (0, 6, 13, 20):
        assert our_data[i][DEPTH].dtype == theirs[i][DEPTH].dtype
        np.testing.assert_array_equal(our_data[i][DEPTH], theirs[i][DEPTH])
        # In a process that has run many other tests, LeRobot's own encoding differs by a few levels
        # in some pixels; `test_dataset.py` compares the bytes of pixels.
        np.testing.assert_allclose(our_data[i][RGB], theirs[i][RGB], atol=12 / 255)
    written = stored(make_images(13, 0)[1][6], "image") / (1000 if unit == "m" else 1)
    np.testing.assert_allclose(our_data[6][DEPTH].numpy()[0], written, rtol=1e-6)


def test_rows_with_images_begin_new_files_too(tmp_path: Path) -> None:
    units = write_units(tmp_path, [1.0] * 4, depth_storage="image")
    assemble_dataset(units, tmp_path / "set", limits=FileLimits(data_mb=0.06), **ASSEMBLY)
    assert len(list((tmp_path / "set" / "data").rglob("*.parquet"))) > 1
    dataset = load(tmp_path / "set", depth_output_unit="m")
    limit = RANGE.far_m
    assert all(0 < float(dataset[i][DEPTH].max()) <= limit for i in range(len(dataset)))


def test_another_way_to_keep_depth_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="image, video"):
        write_unit(tmp_path, make_rollout(1.0), depth_storage="png")
    assert not (tmp_path / "unit-0").exists()


def test_units_with_and_without_images_do_not_mix(tmp_path: Path) -> None:
    image = write_unit(tmp_path, make_rollout(1.0), 0, depth_storage="image")
    units = [image, write_unit(tmp_path, make_rollout(1.0), 1)]
    with pytest.raises(FileFormatError, match="features differs"):
        assemble_dataset(units, tmp_path / "set", **ASSEMBLY)


@settings(max_examples=30, deadline=None)
@given(
    shape=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    seed=st.integers(0, 2**32 - 1),
    smooth=st.booleans(),
)
def test_tiffs_lose_nothing(shape: tuple[int, int], seed: int, smooth: bool) -> None:
    rng = np.random.default_rng(seed)
    depth = rng.integers(0, 65536, shape).astype(np.uint16)
    if smooth:
        depth = np.sort(depth, axis=1)
    np.testing.assert_array_equal(decode_depth_tiff(encode_depth_tiff(depth)), depth)


@pytest.mark.parametrize("data", [b"", b"II*\0", encode_depth_tiff(np.ones((9, 9), "u2"))[:40]])
def test_broken_tiffs_are_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match="depth image"):
        decode_depth_tiff(data)


def test_depth_reads_back_the_same_from_images_and_videos(tmp_path: Path) -> None:
    images = make_images(9, 0)
    image, video = (
        read_episode_unit(
            write_unit(tmp_path, make_rollout(2.0), k, images=images, depth_storage=s)
        )
        for k, s in enumerate(("image", "video"))
    )
    for a, b in zip(image.depth_m([0, 3, 8]), video.depth_m([0, 3, 8]), strict=True):
        np.testing.assert_allclose(a, b, atol=5.1e-4)


@pytest.mark.parametrize("stored", ["image", "video"])
def test_how_depth_was_rendered_does_not_show_in_a_unit(tmp_path: Path, stored: str) -> None:
    units = [
        write_unit(tmp_path, make_rollout(2.0), k, images=make_images(9, 0), depth_storage=stored,
                   rendered_as=rendered)
        for k, rendered in enumerate(("image", "video"))
    ]  # fmt: skip
    for name in {"rows.parquet", "unit.json", *([f"{DEPTH}.mp4"] if stored == "video" else [])}:
        one, two = (unit / name for unit in units)
        assert one.read_bytes() == two.read_bytes(), name


def test_images_become_a_video_in_a_new_folder_and_a_kill_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, killed = tmp_path / "new" / "units", tmp_path / "killed"

    def seen_meanwhile(*options: Any) -> int:
        shutil.copytree(folder, killed)  # what a process would leave that is killed here
        return write_depth_video(*options)

    monkeypatch.setattr("vlnpe.formats.lerobot.units.unit.write_depth_video", seen_meanwhile)
    path = write_unit(tmp_path, make_rollout(1.0), rendered_as="image", units=folder)
    assert read_episode_unit(path).length == 5
    assert list(folder.iterdir()) == [path] and list(killed.iterdir())
    sweep_beside([killed / path.name])
    assert not list(killed.iterdir())


def test_depth_frames_must_be_alike(tmp_path: Path) -> None:
    frames = [np.ones((8, 8), np.float32), np.ones((8, 10), np.float32)]
    with pytest.raises(ValueError, match="depth frame 1 of shape"):
        write_depth_images(tmp_path / "depth.mov", frames, 4, RANGE)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("depth_max", [None, "far", float("nan"), 0.0, True])
def test_depth_videos_of_an_unknown_range_are_refused(tmp_path: Path, depth_max: Any) -> None:
    assemble_dataset([write_unit(tmp_path, make_rollout(1.0, 0), 0)], tmp_path / "set", **ASSEMBLY)
    path = tmp_path / "set" / "meta" / "info.json"
    info = json.loads(path.read_text())
    EpisodeReader(read_index(tmp_path / "set"))
    info["features"][DEPTH]["info"]["video.depth_max"] = depth_max
    path.write_text(json.dumps(info))
    with pytest.raises(FileFormatError, match=r"video\.depth_max.*valid: metres"):
        EpisodeReader(read_index(tmp_path / "set"))
