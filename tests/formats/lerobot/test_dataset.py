"""Our LeRobot writer against LeRobot itself: it loads, and equals what LeRobot writes."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.lerobot_data import (
    DEPTH,
    RANGE,
    RGB,
    assert_same_schemas,
    load,
    write_reference,
    write_unit,
    write_units,
)
from tests.support.rollouts import make_frames, make_images, make_rollout, with_body
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.lerobot import FileLimits, assemble_dataset, read_episode_unit
from vlnpe.formats.lerobot.film_strip import GAP_PX, HEAD_PX, LINE_PX
from vlnpe.formats.lerobot.splits import held_out_scenes
from vlnpe.formats.rendered.table import build_frame_table
from vlnpe.formats.video.depth_picture import SCALE_PX, depth_scale

pytestmark = pytest.mark.usefixtures("offline")
SECONDS = (3.0, 0.0, 4.5, 2.0)
PARTS = ("data", f"videos/{RGB}", f"videos/{DEPTH}")
VIDEO_MB = {"one video": 200, "several videos": 0.002}
ASSEMBLY: dict[str, Any] = {
    "provenance": {"config": "abc", "seed": 3},
    "licence": "apache-2.0",
    "title": "Two rooms",
}


@pytest.fixture(scope="module")
def units(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return write_units(tmp_path_factory.mktemp("units"), SECONDS)


@pytest.fixture(scope="module")
def ours(units: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("ours") / "dataset"
    summary = assemble_dataset(units, root, **ASSEMBLY)
    assert (summary.episodes, summary.frames, summary.tasks) == (4, 13 + 1 + 19 + 9, 1)
    return root


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("reference") / "dataset"
    write_reference(root, SECONDS)
    return root


def test_every_frame_is_what_was_written(ours: Path) -> None:
    dataset = load(ours, depth_output_unit="m")
    assert dataset.num_episodes == len(SECONDS)
    start = 0
    for number, seconds in enumerate(SECONDS):
        rollout = make_rollout(seconds, number, discrete=number % 2 == 1)
        table = build_frame_table(rollout, make_frames(rollout), 4)
        rgb, depth = make_images(len(table), number)
        for i in range(len(table)):
            item = dataset[start + i]
            for key, values in table.columns.items():
                np.testing.assert_array_equal(np.ravel(item[key].numpy()), values[i], err_msg=key)
            image = item[RGB].numpy().transpose(1, 2, 0) * 255
            assert np.sqrt(np.mean((image - rgb[i]) ** 2)) < 6  # 32 dB
            back = item[DEPTH].numpy()[0]
            np.testing.assert_allclose(back, depth[i], atol=0.003)
            assert back[:6, :6].max() < 1e-6
            assert item["task"] == rollout.episode.instruction
            assert item["timestamp"] == np.float32(i / 4)
            assert (item["frame_index"], item["episode_index"]) == (i, number)
        start += len(table)
    assert start == len(dataset)


def test_history_windows_are_padded_at_the_episode_edge(ours: Path) -> None:
    deltas = {RGB: [-0.5, -0.25, 0.0], "action": [0.0, 0.25, 0.5]}
    dataset = load(ours, delta_timestamps=deltas)
    plain = load(ours)
    item = dataset[15]
    assert item[RGB].shape == (3, 3, 64, 96)
    for k, index in enumerate((14, 14, 15)):
        np.testing.assert_array_equal(item[RGB][k], plain[index][RGB])
    assert item[f"{RGB}_is_pad"].tolist() == [True, False, False]
    np.testing.assert_array_equal(item["action"][2], plain[17]["action"])


def test_one_episode_can_be_selected(ours: Path) -> None:
    dataset = load(ours, episodes=[2])
    assert len(dataset) == 19
    assert {int(dataset[i]["episode_index"]) for i in (0, 18)} == {2}
    np.testing.assert_array_equal(dataset[3][RGB], load(ours)[17][RGB])


def test_rows_and_schemas_equal_lerobots(ours: Path, reference: Path) -> None:
    assert_same_schemas(ours, reference)
    data, tasks = "data/chunk-000/file-000.parquet", "meta/tasks.parquet"
    our_file, theirs = pq.ParquetFile(ours / data), pq.ParquetFile(reference / data)
    assert our_file.num_row_groups == theirs.num_row_groups
    assert our_file.read().equals(theirs.read())
    assert pq.read_table(ours / tasks).equals(pq.read_table(reference / tasks))


def test_episodes_equal_lerobots_but_for_more_columns(ours: Path, reference: Path) -> None:
    path = "meta/episodes/chunk-000/file-000.parquet"
    our_table, theirs = pq.read_table(ours / path), pq.read_table(reference / path)
    own = our_table.schema.names[len(theirs.schema.names) :]
    assert "end_reason" in own and "reference_path_world_m" in own
    for name in theirs.schema.names:
        assert our_table.schema.field(name).equals(theirs.schema.field(name)), name
        if not name.startswith("stats/"):
            assert our_table[name].equals(theirs[name]), name
        else:
            for a, b in zip(our_table[name].to_pylist(), theirs[name].to_pylist(), strict=True):
                np.testing.assert_allclose(a, b, atol=tolerance(name, b), err_msg=name)


def test_dataset_statistics_equal_lerobots(ours: Path, reference: Path) -> None:
    our_stats, theirs = (json.loads((p / "meta/stats.json").read_text()) for p in (ours, reference))
    assert our_stats.keys() == theirs.keys()
    for feature, values in theirs.items():
        assert our_stats[feature].keys() == values.keys()
        for name, value in values.items():
            key = f"stats/{feature}/{name}"
            np.testing.assert_allclose(
                our_stats[feature][name], value, atol=tolerance(key, value), err_msg=key
            )


def tolerance(name: str, value: Any) -> float:
    """1e-6 of the value for numbers, 1/255 for colours, a quantisation step for depth."""
    if RGB in name:
        return 1 / 255
    if DEPTH in name:
        return 0.003
    return 1e-6 * max(1.0, float(np.abs(value).max()))


def test_frames_equal_those_lerobot_encodes(ours: Path, reference: Path) -> None:
    our_data, theirs = load(ours), load(reference)
    for i in (0, 5, 13, 14, 20, 41):
        for key in (RGB, DEPTH):
            np.testing.assert_array_equal(our_data[i][key], theirs[i][key])


@pytest.mark.parametrize(("joints", "feet"), [(29, 2), (0, 0)])
def test_lerobot_reads_every_sensor_of_any_body_by_name(
    tmp_path: Path, joints: int, feet: int
) -> None:
    rollout = with_body(make_rollout(2.0, fall=True), joints, feet)
    assemble_dataset([write_unit(tmp_path, rollout)], tmp_path / "set", **ASSEMBLY)
    dataset = load(tmp_path / "set")
    features, item = dataset.meta.features, dataset[4]
    sample = rollout.frame_samples(4)[4]
    assert ("observation.joints" in features) == bool(joints)
    if joints:
        assert features["observation.joints"]["names"] == [
            *(f"joint_{k:02d}_position_rad" for k in range(29)),
            *(f"joint_{k:02d}_velocity_rad_s" for k in range(29)),
        ]
        joint = item["observation.joints"].numpy()
        np.testing.assert_array_equal(joint[:29], rollout.joint_position_rad[sample].astype("f4"))
        names = features["observation.foot_contact"]["names"]
        assert names == ["left_foot_contact_0_or_1", "right_foot_contact_0_or_1"]
        touching = item["observation.foot_contact"].numpy()
        np.testing.assert_array_equal(touching, rollout.foot_contact[sample])
    np.testing.assert_array_equal(item["observation.imu"], rollout.imu[sample].astype("f4"))
    assert features["observation.imu"]["names"][0] == "specific_force_x_base_m_s2"
    assert dataset.meta.episodes[0]["end_reason"] == "fall"


def test_episode_columns_describe_the_episode(ours: Path) -> None:
    episodes = load(ours).meta.episodes
    assert episodes["end_reason"] == ["success", "success", "success", "fall"]
    assert episodes["action_discrete_derived"] == [True, False, True, False]
    first = episodes[0]
    rollout = make_rollout(SECONDS[0], 0)
    assert first["instructions"] == rollout.episode.extra["instructions"]
    np.testing.assert_array_equal(
        np.reshape(first["reference_path_world_m"], (-1, 3)), rollout.episode.reference_path_world_m
    )
    assert first["metrics/ndtw"] == rollout.metrics.ndtw
    assert first["metrics/success"] is True
    assert first["camera_intrinsics"] == pytest.approx([48, 0, 47.5, 0, 48, 31.5, 0, 0, 1])
    assert first["episode_uid"] == "train/two_rooms/ep0"
    assert first["depth_far_m"] == RANGE.far_m
    origin = [*rollout.position_world_m[0, :2], rollout.floor_z_m[0]]
    assert first["start_frame_origin_world_m"] == pytest.approx(origin)


def test_card_splits_and_provenance(ours: Path) -> None:
    card = (ours / "README.md").read_text()
    assert card.startswith("---\nlicense:") and "# Two rooms" in card and "4 episodes" in card
    assert "none is held out" in card
    assert json.loads((ours / "meta/splits.json").read_text()) == {"train": [0, 1, 2, 3]}
    assert json.loads((ours / "meta/provenance.json").read_text()) == ASSEMBLY["provenance"]
    from huggingface_hub import DatasetCard

    front = DatasetCard.load(ours / "README.md").data.to_dict()
    assert front["license"] == "apache-2.0"
    assert front["task_categories"] == ["robotics"] and "LeRobot" in front["tags"]
    assert front["configs"] == [{"config_name": "default", "data_files": "data/*/*.parquet"}]
    strip = cv2.imread(str(ours / "film_strip.png"))
    assert "](film_strip.png)" in card
    assert strip is not None and (strip[:GAP_PX] == 255).all() and (strip[:, :GAP_PX] == 255).all()
    strip = strip[GAP_PX:-GAP_PX, GAP_PX:-GAP_PX]
    # Three of the episodes, six frames of each: name and times, colour, depth with its scale.
    rows = 3 * (HEAD_PX + 2 * 107) + 8 * GAP_PX
    assert strip.shape == (rows, 6 * 164 + SCALE_PX, 3)
    head, scale = strip[:HEAD_PX], strip[HEAD_PX + 115 :][:107, 6 * 164 :]
    assert (scale == depth_scale(107)[..., ::-1]).all()
    times = np.split(head[LINE_PX:, : 6 * 164], 6, axis=1)
    assert all((time < 128).any() for time in times) and (head[:LINE_PX] < 128).any()


def test_scenes_are_in_one_split_only(tmp_path: Path) -> None:
    units = []
    for number in range(8):
        rollout = make_rollout(0.5, number)
        split = "val_unseen" if number == 7 else "train"
        texts = [rollout.episode.instruction, f"Another way to say it, number {number}."]
        episode = replace(
            rollout.episode,
            scene_id=f"scene-{number // 2}",
            split=split,
            extra={**rollout.episode.extra, "instructions": texts},
        )
        units.append(write_unit(tmp_path, replace(rollout, episode=episode), number))
    scenes = {f"scene-{k}": {"licence": name} for k, name in enumerate(("MIT", "MIT-0", "", ""))}
    held_out = held_out_scenes(scenes)
    assert len(held_out) == 1
    provenance = {"scenes": scenes, "held_out_scenes": sorted(held_out)}
    assemble_dataset(units, tmp_path / "set", **{**ASSEMBLY, "provenance": provenance})
    splits = json.loads((tmp_path / "set/meta/splits.json").read_text())
    assert sorted(i for numbers in splits.values() for i in numbers) == list(range(8))
    table = pq.read_table(tmp_path / "set/meta/episodes")
    scene_of = table["scene_id"].to_pylist()
    labels = table["split"].to_pylist()
    assert all(labels[i] == name for name, numbers in splits.items() for i in numbers)
    scenes_of = {name: {scene_of[i] for i in numbers} for name, numbers in splits.items()}
    assert scenes_of["val"] == held_out and not scenes_of["train"] & scenes_of["val"]
    assert splits["val_unseen"] == [7]
    card = (tmp_path / "set/README.md").read_text()
    assert '"mit-and-mit-0-and-unknown"' in card and "| scene-1 | mit-0 |" in card
    tasks = json.loads((tmp_path / "set/meta/info.json").read_text())["total_tasks"]
    assert f"{tasks + 8} instructions, {tasks} of them as tasks" in card
    statement = "Some scenes are in two splits" if held_out != {"scene-3"} else "No scene"
    assert statement in card


@given(st.sets(st.text(min_size=1), max_size=60))
def test_a_tenth_of_several_scenes_is_held_out_whatever_the_robot(scenes: set[str]) -> None:
    held_out = held_out_scenes(scenes)
    assert held_out <= scenes
    assert len(held_out) == (0 if len(scenes) < 2 else max(1, round(0.1 * len(scenes))))
    assert held_out_scenes(sorted(scenes, reverse=True)) == held_out


@pytest.mark.parametrize("rate", [4, 10, 25])
def test_small_files_split_and_times_stay_exact(tmp_path: Path, rate: int) -> None:
    units = write_units(tmp_path, [1.0] * 6, rate)
    limits = FileLimits(files_per_chunk=2, data_mb=max(0.012, 0.0015 * rate), video_mb=0.001 * rate)
    assemble_dataset(units, tmp_path / "set", limits=limits, **ASSEMBLY)
    videos = sorted((tmp_path / "set" / "videos" / RGB).rglob("*.mp4"))
    assert len(videos) > 2
    assert videos[2].as_posix().endswith(f"videos/{RGB}/chunk-001/file-000.mp4")
    assert len(list((tmp_path / "set" / "data").rglob("*.parquet"))) > 1
    whole = tmp_path / "whole"
    assemble_dataset(units, whole, **ASSEMBLY)
    split, single = load(tmp_path / "set"), load(whole)
    assert len(split) == len(single) == 6 * (rate + 1)
    # The frames of an episode lie in files of different numbers, which readers have mixed up.
    columns = split.meta.episodes
    files = [
        tuple(zip(columns[f"{part}/chunk_index"], columns[f"{part}/file_index"], strict=True))
        for part in PARTS
    ]
    assert files[0] != files[1]
    for i in range(0, len(single), 1 if rate == 4 else 7):
        one, other = split[i], single[i]
        for key in (RGB, DEPTH, "action", "index", "timestamp"):
            np.testing.assert_array_equal(one[key], other[key])


@pytest.mark.parametrize("writer", ["vlnpe", "lerobot"])
def test_lerobot_streams_several_data_files_but_not_several_videos(
    tmp_path: Path, writer: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """LeRobot 0.6.1 takes a frame's time in its video from its number in the whole dataset."""
    if writer == "vlnpe":
        units = write_units(tmp_path, [1.0, 1.0, 6.0])
        small = {name: FileLimits(data_mb=0.012, video_mb=mb) for name, mb in VIDEO_MB.items()}
        for name, limits in small.items():
            assemble_dataset(units, tmp_path / name, limits=limits, **ASSEMBLY)
    else:
        from lerobot.datasets.aggregate import aggregate_datasets

        write_reference(tmp_path / "a", [1.0, 1.0])
        write_reference(tmp_path / "b", [6.0])
        for name, mb in VIDEO_MB.items():
            sources = [tmp_path / "a", tmp_path / "b"]
            names = ["vlnpe/a", "vlnpe/b"]
            sizes = {"data_files_size_in_mb": 1, "video_files_size_in_mb": mb}
            aggregate_datasets(names, "vlnpe/both", sources, tmp_path / name, **sizes)
    same = {name: streamed_as_loaded(tmp_path / name, monkeypatch) for name in VIDEO_MB}
    assert all(same["one video"]) and len(same["one video"]) == 5 + 5 + 25
    wrong = same["several videos"]
    assert not all(wrong), "LeRobot streams several videos: say so in docs/guides/lerobot.md"


def streamed_as_loaded(root: Path, monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Whether each streamed frame equals the loaded one; False also where LeRobot finds none."""
    from lerobot.datasets import streaming_dataset
    from lerobot.datasets.video_utils import FrameTimestampError, decode_video_frames

    def decode(path: Path, times: Any, tolerance_s: float, **options: Any) -> Any:
        return decode_video_frames(path, times, tolerance_s, "pyav", options["return_uint8"])

    monkeypatch.setattr(streaming_dataset, "decode_video_frames_torchcodec", decode)
    stream = streaming_dataset.StreamingLeRobotDataset("vlnpe/test", root=root, shuffle=False)
    loaded, result = load(root), []
    try:
        for item in stream:
            same = loaded[int(item["index"])]
            result.append(all(np.array_equal(item[key], same[key]) for key in (RGB, DEPTH)))
    except FrameTimestampError:
        result.append(False)
    return result


def test_statistics_from_decoded_videos_agree_with_counted_ones(tmp_path: Path) -> None:
    rollout = make_rollout(3.0)
    counted = read_episode_unit(write_unit(tmp_path, rollout)).statistics
    decoded = read_episode_unit(write_unit(tmp_path, rollout, counted=False)).statistics
    np.testing.assert_allclose(counted[RGB]["mean"], decoded[RGB]["mean"], atol=2 / 255)
    for name in ("mean", "std", "min", "max", "q10", "q50"):
        np.testing.assert_array_equal(counted[DEPTH][name], decoded[DEPTH][name])


def test_large_images_are_thinned_as_lerobot_does(tmp_path: Path) -> None:
    from lerobot.datasets.compute_stats import auto_downsample_height_width, get_feature_stats

    rollout = make_rollout(0.5)
    images = make_images(3, height=360, width=480)
    stats = read_episode_unit(write_unit(tmp_path, rollout, images=images)).statistics[RGB]
    thin = np.stack([auto_downsample_height_width(i.transpose(2, 0, 1)) for i in images[0]])
    theirs = get_feature_stats(thin, axis=(0, 2, 3), keepdims=True)
    for name in ("min", "max", "mean", "std", "q01", "q50", "q99"):
        np.testing.assert_allclose(stats[name] * 255, theirs[name][0], atol=0.1, err_msg=name)


def halve(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def rename_robot(index: Path) -> None:
    index.write_text(index.read_text().replace('"robot": "aliengo"', '"robot": "h1"', 1))


@pytest.mark.parametrize(
    ("name", "damage", "reason"),
    [
        ("unit.json", Path.unlink, "unit.json"),
        ("unit.json", halve, "not JSON"),
        (f"{RGB}.mp4", Path.unlink, "missing"),
        (f"{RGB}.mp4", halve, "rgb"),
        ("rows.parquet", halve, "not readable"),
        ("unit.json", rename_robot, "robot differs"),
    ],
)
def test_damaged_units_are_named_and_nothing_is_left(
    units: list[Path], tmp_path: Path, name: str, damage: Callable[[Path], None], reason: str
) -> None:
    bad = tmp_path / "bad"
    shutil.copytree(units[2], bad)
    damage(bad / name)
    out = tmp_path / "out" / "dataset"
    with pytest.raises(FileFormatError, match=reason):
        assemble_dataset([units[0], bad], out, **ASSEMBLY)
    assert not out.parent.exists() or list(out.parent.iterdir()) == []


def test_a_video_of_another_length_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="expected"):
        write_unit(tmp_path, make_rollout(2.0), images=make_images(5))
    assert not (tmp_path / "unit-0").exists()


def test_a_failed_assembly_keeps_the_dataset_before(units: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "dataset"
    assemble_dataset(units[:2], out, **ASSEMBLY)
    with pytest.raises(FileFormatError):
        assemble_dataset([*units, tmp_path / "none"], out, **ASSEMBLY)
    assert json.loads((out / "meta/info.json").read_text())["total_episodes"] == 2


def test_the_core_needs_neither_torch_nor_lerobot() -> None:
    code = (
        "import sys, vlnpe.formats.lerobot;"
        "print([m for m in ('torch', 'lerobot', 'datasets', 'pandas') if m in sys.modules])"
    )
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert output.stdout.strip() == "[]", output.stderr
