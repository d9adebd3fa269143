"""InternNav's loaders read our layout, and it comes back."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.formats.internnav.layouts import (
    DEPTH,
    RGB,
    loader_data,
    loader_keys,
    truth,
)
from tests.support.lerobot_data import write_unit
from tests.support.rollouts import make_images, make_rollout
from vlnpe.formats.core.camera import DepthRange
from vlnpe.formats.internnav.foreign import Assumptions
from vlnpe.formats.internnav.layout import scene_name
from vlnpe.formats.internnav.reader import find_scenes
from vlnpe.formats.internnav.to_unit import unit_from_layout
from vlnpe.formats.internnav.writer import SceneEpisode, write_scene
from vlnpe.formats.lerobot import read_episode_unit
from vlnpe.formats.lerobot.units.rows import row_arrays
from vlnpe.formats.rendered.discrete_steps import discrete_steps, execute, planar_poses
from vlnpe.formats.video.mp4 import iterate_depth_codes, read_rgb_video
from vlnpe.formats.vlnce.vocabulary import Vocabulary

STATE = "observation.state"


def test_internnavs_loaders_read_ours(layout: Path) -> None:
    keys = list(loader_keys(layout, ["r2r"]))
    assert keys == [f"r2r_two-rooms_000_{k:06d}" for k in range(3)]
    for number, key in enumerate(keys):
        data, rollout = loader_data(layout, key), truth(number)
        samples = rollout.frame_samples(4)
        count = len(samples)
        for name in ("position", "orientation", "yaw", "progress", "step", "action"):
            assert len(data[name]) == count
        np.testing.assert_allclose(data["position"], rollout.position_world_m[samples], atol=2e-6)
        same = np.sum(data["orientation"] * rollout.quat_wxyz[samples], axis=1)
        np.testing.assert_allclose(np.abs(same), 1.0, atol=1e-6)
        w, x, y, z = data["orientation"].T
        yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        np.testing.assert_allclose(data["yaw"], yaw)
        # The camera is mounted straight ahead, 15° down: its frame looks along x.
        np.testing.assert_allclose(np.cos(data["camera_yaw"] - yaw), 1.0, atol=1e-4)
        assert data["rgb"].shape == (count, 64, 96, 3) and data["rgb"].dtype == np.uint8
        assert data["depth"].shape == (count, 64, 96) and data["depth"].dtype == np.float32
        assert data["depth"].min() > 0 and data["depth"].max() == 1  # nothing there is far away
        _, depth = make_images(count, number)
        np.testing.assert_allclose(data["depth"][:, 6:] * 10, depth[:, 6:], atol=0.004)
        assert data["action"][:-1].tolist() == [1 + k % 3 for k in range(count - 1)]
        assert data["action"][-1] == 0
        # CMA's previous actions: internnav/dataset/base.py, _create_new_data.
        assert np.concatenate([[0], data["action"][:-1]]).shape == (count,)
        fell = number == 2
        assert data["tasks"][-1]["finish_status"] == ("fail" if fell else "success")
        assert data["tasks"][-1]["fail_reason"] == ("fall" if fell else "success")


def test_a_row_is_a_discrete_step_that_leads_to_the_end(tmp_path: Path) -> None:
    """InternNav computes motions from the actions: they must end where the robot did."""
    rollout = make_rollout(8.0)  # by a continuous controller
    folder = write_unit(tmp_path / "unit", rollout)
    write_scene(tmp_path / "n1/r2r/s", [SceneEpisode(folder, ("Go.",))], Vocabulary.of(["Go."]))
    data = loader_data(tmp_path / "n1", "r2r_s_000_000000")
    actions, count = data["action"], len(data["action"])
    assert actions[-1] == 0 and actions[:-1].all() and (actions > 1).any()
    assert len(data["position"]) == len(data["rgb"]) == len(data["depth"]) == count
    start = np.array([*data["position"][0, :2], data["yaw"][0]])
    end = execute(actions, start)[-1]
    assert np.hypot(*(end[:2] - data["position"][-1, :2])) < 0.5
    np.testing.assert_allclose(
        data["position"][-1], rollout.position_world_m[rollout.frame_samples(4)[-1]], atol=1e-5
    )
    poses = np.column_stack([data["position"][:, :2], np.unwrap(data["yaw"])])
    assert np.hypot(*(execute(actions, start)[:-1] - poses)[:, :2].T).max() < 0.6
    # Images are those of the rows' own frames, some of them twice.
    steps = discrete_steps(planar_poses(row_arrays(read_episode_unit(folder).rows())[STATE]))
    np.testing.assert_array_equal(actions, steps.action)
    whole = read_rgb_video(read_episode_unit(folder).video(RGB))
    np.testing.assert_array_equal(data["rgb"], whole[steps.frame])
    # It comes back as an episode of these rows.
    (scene,) = find_scenes(tmp_path / "n1")
    unit_from_layout(scene, 0, tmp_path / "back", Assumptions())
    back = read_episode_unit(tmp_path / "back")
    assert back.length == count
    assert row_arrays(back.rows())["action.discrete"].ravel().tolist() == actions.tolist()


def test_instructions_are_listed_once_and_have_tokens(layout: Path) -> None:
    keys = loader_keys(layout, ["r2r"])
    tasks = [loader_data(layout, key)["tasks"] for key in keys]
    own = make_rollout(0.0).episode.instruction
    assert [[t["task"] for t in line] for line in tasks] == [[own, "Go to the sofa."], [own], [own]]
    for line in (task for own in tasks for task in own):
        tokens = line["instruction_tokens"]
        assert len(tokens) == 200 and min(tokens) >= 0 and max(tokens) < 2504
        assert sum(map(bool, tokens)) == len(line["task"].replace(".", " .").split())
        assert line["instruction_text"] == line["task"]
        assert line["episode_id"].startswith("ep")


def test_metadata_agrees_with_itself(layout: Path) -> None:
    meta = layout / "r2r" / "two-rooms" / "meta"
    info = json.loads((meta / "info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["robot_type"]) == ("v2.1", 4, "h1")
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (3, 39, 4)
    episodes = [json.loads(s) for s in (meta / "episodes.jsonl").read_text().splitlines()]
    assert [e["length"] for e in episodes] == [9, 13, 17]
    for number in range(3):
        place = {"episode_chunk": 0, "episode_index": number}
        table = pq.read_table(meta.parent / info["data_path"].format(**place))
        stamps = table["timestamp"].to_numpy()
        np.testing.assert_array_equal(stamps, np.arange(len(stamps), dtype=np.float32) / 4)
        assert (meta.parent / info["video_path"].format(video_key=RGB, **place)).is_file()


def test_ours_comes_back_exactly_but_for_colour(
    layout: Path, units: list[Path], tmp_path: Path
) -> None:
    (scene,) = find_scenes(layout)
    for number, made in enumerate(units):
        folder = tmp_path / f"back-{number}"
        facts = unit_from_layout(scene, number, folder, Assumptions())
        assert facts.ours
        one, two = read_episode_unit(made), read_episode_unit(folder)
        assert (one.features, one.columns, one.task) == (two.features, two.columns, two.task)
        assert one.rows().equals(two.rows())
        codes = zip(
            iterate_depth_codes(one.video(DEPTH), DepthRange()),
            iterate_depth_codes(two.video(DEPTH), DepthRange()),
            strict=True,
        )
        assert all(np.array_equal(a, b) for a, b in codes)
        before, after = read_rgb_video(one.video(RGB)), read_rgb_video(two.video(RGB))
        error = np.mean((before.astype(float) - after) ** 2)
        assert 10 * np.log10(255**2 / error) > 35


@pytest.mark.parametrize(
    ("scene_id", "folder"),
    [
        ("mp3d/17DRP5sb8fy/17DRP5sb8fy.glb", "17DRP5sb8fy"),
        ("small_house", "small-house"),
        ("flash", "flash-scene"),
    ],
)
def test_scene_folders_survive_the_loaders_keys(scene_id: str, folder: str) -> None:
    assert scene_name(scene_id) == folder and "_" not in folder
