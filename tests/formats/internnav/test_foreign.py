"""The layout as others write it becomes units."""

import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.formats.internnav.layouts import (
    DEPTH,
    make_foreign,
    truth,
)
from tests.support.rollouts import make_frames, make_images
from vlnpe.formats.core.camera import DepthRange
from vlnpe.formats.core.errors import FileFormatError, InputError
from vlnpe.formats.core.rollout import EndReason, Rollout
from vlnpe.formats.internnav.foreign import Assumptions
from vlnpe.formats.internnav.reader import find_scenes, read_layout_episode
from vlnpe.formats.internnav.to_unit import unit_from_layout
from vlnpe.formats.lerobot import read_episode_unit
from vlnpe.formats.rendered.table import build_frame_table
from vlnpe.formats.video.depth_codes import depth_to_codes
from vlnpe.formats.video.mp4 import iterate_depth_codes


def test_theirs_becomes_units_with_what_is_known(layout: Path, tmp_path: Path) -> None:
    (scene,) = find_scenes(make_foreign(layout))
    for number in range(3):
        rollout = truth(number)
        facts = unit_from_layout(scene, number, tmp_path / "u", Assumptions(hfov_deg=80.0))
        assert not facts.ours and (facts.fps, round(facts.timestamp_step_s or 0, 3)) == (30, 0.167)
        unit = read_episode_unit(tmp_path / "u")
        assert (unit.robot, unit.frames_per_second) == ("h1", 4)
        rows = {k: np.array(v) for k, v in unit.rows().to_pydict().items()}
        expected = frame_columns(rollout)
        # The same start frame, except for the floor, which is assumed below the base.
        rows["observation.state"][:, 2] += rollout.position_world_m[0, 2] - rollout.floor_z_m[0] - 1
        rows["observation.camera_pose"][:, 2] += (
            rollout.position_world_m[0, 2] - rollout.floor_z_m[0] - 1
        )
        for key in ("action", "observation.camera_pose", "observation.progress"):
            np.testing.assert_allclose(
                rows[key].reshape(expected[key].shape), expected[key], atol=2e-5, err_msg=key
            )
        state, known = rows["observation.state"], expected["observation.state"]
        np.testing.assert_allclose(state[:, :7], known[:, :7], atol=2e-5)
        np.testing.assert_allclose(state[2:-2, 7], known[2:-2, 7], atol=0.06)  # differences
        np.testing.assert_allclose(state[2:-2, 12], known[2:-2, 12], atol=0.06)
        np.testing.assert_array_equal(rows["action.discrete"], expected["action.discrete"][:, 0])
        columns = unit.columns
        assert columns["camera_hfov_deg"] == 80.0
        assert columns["end_reason"] == (EndReason.FALL if number == 2 else EndReason.SUCCESS)
        assert columns["start_frame_origin_world_m"][2] == pytest.approx(
            rollout.position_world_m[0, 2] - 1.0
        )
        assert columns["episode_id"] == f"r2r-two-rooms-{number:06d}"
        _, depth = make_images(unit.length, number)
        limits = DepthRange(0.05, 10.0)
        decoded = iterate_depth_codes(unit.video(DEPTH), limits)
        for image, codes in zip(depth, decoded, strict=True):
            expected_codes = depth_to_codes(image, limits)
            np.testing.assert_allclose(codes, expected_codes, atol=3)


@pytest.mark.parametrize(
    ("reason", "success"), [("stopped_near", True), ("stopped_far", False), ("unsaid", False)]
)
def test_a_stop_near_the_goal_is_a_success_of_evaluations(
    reason: str, success: bool, layout: Path, tmp_path: Path
) -> None:
    (scene,) = find_scenes(make_foreign(layout))
    tasks = scene.folder / "meta/tasks.jsonl"
    lines = [json.loads(line) for line in tasks.read_text().splitlines()]
    ends = {"finish_status": "fail", "fail_reason": reason}
    tasks.write_text("".join(json.dumps(line | ends) + "\n" for line in lines))
    unit_from_layout(scene, 0, tmp_path / "u", Assumptions())
    columns = read_episode_unit(tmp_path / "u").columns
    assert columns["end_reason"] == ("stopped_near" if success else "stopped_far")
    assert columns["metrics/success"] is columns["metrics/oracle_success"] is success


def test_missing_facts_are_named(layout: Path) -> None:
    assert "oracle_success" in json.dumps(Assumptions().note()["derived"])


def frame_columns(rollout: Rollout) -> dict[str, np.ndarray]:
    return build_frame_table(rollout, make_frames(rollout), 4).columns


@pytest.mark.parametrize("scan", ["r2r", "r2r_aliengo", "mine"])
def test_the_robot_comes_from_options_info_or_folder(
    layout: Path, tmp_path: Path, scan: str
) -> None:
    (scene,) = find_scenes(make_foreign(layout, scan))
    assert scene.scan == scan
    if scan == "mine":
        with pytest.raises(InputError, match="does not name its robot"):
            unit_from_layout(scene, 0, tmp_path / "u", Assumptions())
        with pytest.raises(InputError, match="base is unknown"):
            unit_from_layout(scene, 0, tmp_path / "u", Assumptions(robot="jetbot"))
        unit_from_layout(scene, 0, tmp_path / "u", Assumptions("jetbot", base_height_m=0.15))
    else:
        unit_from_layout(scene, 0, tmp_path / "u", Assumptions())
    robots = {"r2r": "h1", "r2r_aliengo": "aliengo", "mine": "jetbot"}
    assert read_episode_unit(tmp_path / "u").robot == robots[scan]


@pytest.mark.parametrize("place", ["statistics", "nested", "rows", "episodes"])
def test_each_episode_has_its_own_instructions_wherever_they_are_listed(
    layout: Path, place: str
) -> None:
    (scene,) = find_scenes(make_foreign(layout))
    tasks = scene.folder / "meta/tasks.jsonl"
    texts = [json.loads(line) for line in tasks.read_text().splitlines()]
    for line in texts:
        line["task"] = f"{line['task']} {line['task_index']}"
    tasks.write_text("".join(json.dumps(line) + "\n" for line in texts))
    known = [read_layout_episode(scene.folder, number) for number in range(3)]
    assert len({episode.tasks for episode in known}) == 3
    episodes = [
        json.dumps({"episode_index": number, "tasks": list(episode.tasks)})
        for number, episode in enumerate(known)
    ]
    (scene.folder / "meta/episodes.jsonl").write_text("\n".join(episodes))
    stats = scene.folder / "meta/episodes_stats.jsonl"
    lines = [json.loads(line) for line in stats.read_text().splitlines()]
    for number in range(3):
        if place == "nested":
            span = {k: [v] for k, v in lines[number]["task_index"].items() if k in ("min", "max")}
            lines[number] = {"episode_index": number, "stats": {"task_index": span}}
        elif place == "episodes":
            rows = scene.folder / f"data/chunk-000/episode_{number:06d}.parquet"
            pq.write_table(pq.read_table(rows).drop_columns(["task_index"]), rows)
    if place in ("rows", "episodes"):
        lines = []
    stats.write_text("".join(json.dumps(line) + "\n" for line in lines))
    for number in range(3):
        found = read_layout_episode(scene.folder, number)
        # A row names one task; the span of the statistics may hold more instructions of the path.
        assert found.tasks == known[number].tasks or (
            place == "rows" and found.tasks and set(found.tasks) <= set(known[number].tasks)
        )
        assert found.finish_status == known[number].finish_status


def test_repeated_instructions_count_once(layout: Path, tmp_path: Path) -> None:
    scene = make_foreign(layout) / "r2r" / "two-rooms"
    tasks = scene / "meta/tasks.jsonl"
    lines = [json.loads(line) for line in tasks.read_text().splitlines()]
    lines[1]["task"] = lines[0]["task"]
    tasks.write_text("".join(json.dumps(line) + "\n" for line in lines))
    unit_from_layout(find_scenes(scene)[0], 0, tmp_path / "u", Assumptions())
    assert read_episode_unit(tmp_path / "u").columns["instructions"] == [lines[0]["task"]]


def test_trajectory_folders_are_found_at_any_depth(layout: Path) -> None:
    scene = layout / "r2r" / "two-rooms"
    moved = layout / "r2r" / "apartment" / "trajectory_7"
    moved.parent.mkdir()
    scene.rename(moved)
    for root in (layout, layout / "r2r", moved.parent, moved):
        (found,) = find_scenes(root)
        assert (found.scan, found.scene, found.episodes) == ("r2r", "apartment", (0, 1, 2))
    shutil.rmtree(moved)
    with pytest.raises(FileFormatError, match="no VLN-PE scene"):
        find_scenes(layout)
