"""InternData-N1's VLN-PE layout: InternNav's loaders read ours, and theirs becomes units."""

from __future__ import annotations

import contextlib
import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.formats.convert.test_convert import inline  # noqa: F401 (a fixture)
from tests.formats.mcap.test_episode import decode
from tests.support.lerobot_data import write_unit
from tests.support.rollouts import make_frames, make_images, make_rollout
from vlnpe.formats.convert.dataset import open_dataset
from vlnpe.formats.core.camera import DepthRange
from vlnpe.formats.core.errors import FileFormatError, InputError
from vlnpe.formats.core.rollout import EndReason, Rollout
from vlnpe.formats.internnav.foreign import Assumptions
from vlnpe.formats.internnav.layout import scan_name, scene_name
from vlnpe.formats.internnav.reader import find_scenes, read_layout_episode
from vlnpe.formats.internnav.to_unit import unit_from_layout
from vlnpe.formats.internnav.tokens import read_vocabulary
from vlnpe.formats.internnav.writer import SceneEpisode, share_instructions, write_scene
from vlnpe.formats.lerobot import assemble_dataset, read_episode_unit
from vlnpe.formats.lerobot.unit_rows import row_arrays
from vlnpe.formats.rendered.discrete_steps import discrete_steps, execute, planar_poses
from vlnpe.formats.rendered.table import build_frame_table
from vlnpe.formats.video.depth_codes import depth_to_codes
from vlnpe.formats.video.mp4 import iterate_depth_codes, read_rgb_video
from vlnpe.formats.vlnce.vocabulary import Vocabulary
from vlnpe.pipeline import cli
from vlnpe.pipeline.engine.ledger import Ledger
from vlnpe.pipeline.stages.convert_source import Options, detect, unit_items

RGB, DEPTH = "observation.images.rgb", "observation.images.depth"


def loader_keys(root: Path, scans: list[str]) -> Iterator[str]:
    """Keys as InternRobotics/InternNav's LerobotAsLmdb.get_all_keys makes them.

    internnav/utils/lerobot_as_lmdb.py: scan folders that are asked for, scenes with data/, chunks.
    """
    for scan in (p for p in root.iterdir() if p.is_dir() and p.name in scans):
        for scene in (p for p in scan.iterdir() if p.is_dir()):
            for file in sorted(scene.glob("data/chunk-*/episode_*.parquet")):
                chunk, number = int(file.parent.name[6:]), int(file.stem[8:])
                yield f"{scan.name}_{scene.name}_{chunk:03d}_{number:06d}"


def loader_data(root: Path, key: str) -> dict[str, Any]:
    """What LerobotAsLmdb.get_data_by_key reads for a key, by its names."""
    parts = key.split("_")
    scan = parts.pop(0)
    if parts[0] in ("flash", "aliengo"):
        scan = f"{scan}_{parts.pop(0)}"
    scene, chunk, number = root / scan / parts[0], int(parts[-2]), int(parts[-1])
    name = f"chunk-{chunk:03d}/episode_{number:06d}"
    table = pq.read_table(scene / "data" / f"{name}.parquet").to_pydict()
    first = last = 0
    for line in (scene / "meta/episodes_stats.jsonl").read_text().splitlines():
        task_line = json.loads(line)
        if task_line["episode_index"] == number:
            first, last = task_line["task_index"]["min"], task_line["task_index"]["max"]
    lines = (scene / "meta/tasks.jsonl").read_text().splitlines()
    tasks = [t for t in map(json.loads, lines) if first <= t["task_index"] <= last]
    videos = scene / "videos" / f"chunk-{chunk:03d}"
    seen = {k: v for k, v in table.items() if k.startswith("observation.")}
    column = {k.removeprefix("observation."): np.array(v) for k, v in seen.items()}
    return {
        "tasks": tasks,
        "rgb": np.load(videos / RGB / f"episode_{number:06d}.npy"),
        "depth": np.load(videos / DEPTH / f"episode_{number:06d}.npy"),
        **{k: column[f"robot_{k}"] for k in ("position", "orientation", "yaw")},
        **{f"camera_{k}": column[f"camera_{k}"] for k in ("position", "orientation", "yaw")},
        **{k: column[k] for k in ("progress", "step", "action")},
    }


STATE = "observation.state"


def make_unit(root: Path, number: int, seconds: float = 2.0, **changes: Any) -> Path:
    rollout = make_rollout(seconds, number, discrete=True, fall=number == 2)
    return write_unit(root, replace(rollout, robot="h1", **changes), number)


@pytest.fixture(scope="module")
def units(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    root = tmp_path_factory.mktemp("units")
    return [make_unit(root, number, 2.0 + number) for number in range(3)]


@pytest.fixture
def layout(units: list[Path], tmp_path: Path) -> Path:
    """A root with one scene of three episodes."""
    tasks = share_instructions([read_episode_unit(u) for u in units])
    words = Vocabulary.of(text for own in tasks for text in own)
    episodes = [SceneEpisode(u, own) for u, own in zip(units, tasks, strict=True)]
    root = tmp_path / "n1"
    scene = scene_name("two_rooms")
    out = root / scan_name("h1", "path") / scene
    assert write_scene(out, episodes, words, every_frame=True) == 9 + 13 + 17
    return root


def truth(number: int) -> Rollout:
    return make_rollout(2.0 + number, number, discrete=True, fall=number == 2)


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
            iterate_depth_codes(one.video(DEPTH)),
            iterate_depth_codes(two.video(DEPTH)),
            strict=True,
        )
        assert all(np.array_equal(a, b) for a, b in codes)
        before, after = read_rgb_video(one.video(RGB)), read_rgb_video(two.video(RGB))
        error = np.mean((before.astype(float) - after) ** 2)
        assert 10 * np.log10(255**2 / error) > 35


def make_foreign(layout: Path, scan: str = "r2r") -> Path:
    """The layout as others write it: no columns or files of ours, wrong rates, no robot."""
    scene = layout / "r2r" / "two-rooms"
    (scene / "meta" / "vlnpe_episodes.jsonl").unlink()
    info = json.loads((scene / "meta" / "info.json").read_text())
    info |= {"fps": 30, "robot_type": "unknown"}
    (scene / "meta" / "info.json").write_text(json.dumps(info))
    for path in scene.glob("data/chunk-000/*.parquet"):
        table = pq.read_table(path)
        names = [n for n in table.schema.names if n in info["features"]]
        table = table.select(names)
        at = names.index("timestamp")
        stamps = pa.array(np.arange(table.num_rows, dtype=np.float32) / 6)
        pq.write_table(table.set_column(at, "timestamp", stamps), path)
    if scan != "r2r":
        scene.parent.rename(layout / scan)
    return layout


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
        # The same start frame, but for the floor, which is assumed below the base.
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
        for image, codes in zip(depth, iterate_depth_codes(unit.video(DEPTH)), strict=True):
            expected_codes = depth_to_codes(image, DepthRange(0.05, 10.0))
            np.testing.assert_allclose(codes, expected_codes, atol=3)


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


def damage_rows(path: Path, name: str, change: Any) -> None:
    table = pq.read_table(path)
    values = change(np.array(table[name].to_pylist()))
    at = table.schema.names.index(name)
    pq.write_table(table.set_column(at, name, pa.array(values.tolist())), path)


def set_entry(value: Any) -> Any:
    def change(values: np.ndarray) -> np.ndarray:
        values[1] = value
        return values

    return change


DAMAGE: dict[str, str] = {
    "cut colour": "truncated or corrupt",
    "pickled depth": "truncated or corrupt",
    "strange header": "truncated or corrupt",
    "negative length": "truncated or corrupt",
    "far away": r"column observation.robot_position contains 1e\+200",
    "no colour": "no such file",
    "fewer rows": "8 rows, 9 colour and 9 depth frames",
    "fewer depths": "9 rows, 9 colour and 7 depth frames",
    "float colour": r"valid: \(T, H, W, 3\) uint8",
    "other size": "valid: floats",
    "no parquet": "not readable",
    "no column": "no column observation.robot_yaw",
    "not finite": "not finite",
    "no rotation": "a quaternion of length 0",
    "strange action": "action 7; valid: 0 to 3",
    "negative action": "action -2; valid: 0 to 3",
    "timestamp of words": "timestamp; valid: one number a row",
    "no statistics, no rows": "no instruction for episode 0",
    "task of words": "task_index 'x'; valid: a whole number",
    "half a task": "task_index 0.5; valid: a whole number",
    "list of tasks": r"task_index \[0, 1\]; valid: its min and max",
    "empty span": r"task_index \[\]; valid: a whole number",
    "unnumbered task": "task_index 'x'; valid: a whole number",
    "rows of words": "task_index of its rows; valid: one whole number a row",
    "no instruction": "no instruction for episode 0",
    "half a line": r"tasks\.jsonl: not JSON",
}


def write_task_statistics(scene: Path, statistics: dict[str, Any]) -> None:
    """Replace the line of episode 0 in episodes_stats.jsonl."""
    path = scene / "meta/episodes_stats.jsonl"
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    lines[0] = {"episode_index": 0, **statistics}
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))


def break_layout(scene: Path, damage: str) -> None:
    rows = scene / "data/chunk-000/episode_000000.parquet"
    rgb = scene / f"videos/chunk-000/{RGB}/episode_000000.npy"
    depth = scene / f"videos/chunk-000/{DEPTH}/episode_000000.npy"
    tasks = scene / "meta/tasks.jsonl"
    match damage:
        case "cut colour":
            rgb.write_bytes(rgb.read_bytes()[:-1000])
        case "pickled depth":
            np.save(depth, np.array([{"a": 1}], dtype=object), allow_pickle=True)
        case "strange header":
            rgb.write_bytes(rgb.read_bytes().replace(b"'descr'", b"'\x02escr", 1))
        case "negative length":
            rgb.write_bytes(rgb.read_bytes().replace(b"(9, 64", b"(-9,64", 1))
        case "far away":
            damage_rows(rows, "observation.robot_position", set_entry(1e200))
        case "no colour":
            rgb.unlink()
        case "fewer rows":
            pq.write_table(pq.read_table(rows).slice(0, 8), rows)
        case "fewer depths":
            np.save(depth, np.load(depth)[:7])
        case "float colour":
            np.save(rgb, np.load(rgb).astype(np.float32))
        case "other size":
            np.save(depth, np.load(depth)[:, :32])
        case "no parquet":
            rows.write_bytes(b"PAR1")
        case "no column":
            pq.write_table(pq.read_table(rows).drop_columns(["observation.robot_yaw"]), rows)
        case "not finite":
            damage_rows(rows, "observation.robot_yaw", set_entry(np.nan))
        case "no rotation":
            damage_rows(rows, "observation.robot_orientation", set_entry(0.0))
        case "strange action":
            damage_rows(rows, "observation.action", set_entry(7))
        case "negative action":
            damage_rows(rows, "observation.action", set_entry(-2))
        case "timestamp of words":
            damage_rows(rows, "timestamp", lambda values: np.full(len(values), "x"))
        case "no statistics, no rows":
            write_task_statistics(scene, {})
            (scene / "meta/episodes.jsonl").unlink()
            pq.write_table(pq.read_table(rows).drop_columns(["task_index"]), rows)
        case "task of words":
            write_task_statistics(scene, {"task_index": {"min": "x", "max": 0}})
        case "half a task":
            write_task_statistics(scene, {"task_index": {"min": 0, "max": 0.5}})
        case "list of tasks":
            write_task_statistics(scene, {"task_index": [0, 1]})
        case "empty span":
            write_task_statistics(scene, {"stats": {"task_index": {"min": [], "max": [0]}}})
        case "unnumbered task":
            lines = [json.loads(line) | {"task_index": "x"} for line in tasks.open()]
            tasks.write_text("\n".join(map(json.dumps, lines)))
        case "rows of words":
            write_task_statistics(scene, {})
            damage_rows(rows, "task_index", lambda values: np.full(len(values), "x"))
        case "no instruction":
            tasks.write_text("\n".join(tasks.read_text().splitlines()[2:]) + "\n")
        case "half a line":
            tasks.write_text(tasks.read_text()[:-30])


@pytest.mark.parametrize("damage", DAMAGE)
def test_damaged_episodes_are_named(layout: Path, tmp_path: Path, damage: str) -> None:
    (scene,) = find_scenes(make_foreign(layout))
    break_layout(scene.folder, damage)
    with pytest.raises(FileFormatError, match=DAMAGE[damage]):
        unit_from_layout(scene, 0, tmp_path / "out" / "u", Assumptions())
    assert not (tmp_path / "out").exists() or list((tmp_path / "out").iterdir()) == []


@settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data(), foreign=st.booleans())
def test_any_damage_is_named_or_harmless(
    layout: Path, tmp_path: Path, data: st.DataObject, foreign: bool
) -> None:
    scene = tmp_path / "damaged" / "r2r" / "s"
    shutil.rmtree(scene, ignore_errors=True)
    shutil.copytree(layout / "r2r" / "two-rooms", scene)
    if foreign:
        (scene / "meta" / "vlnpe_episodes.jsonl").unlink()
    path = data.draw(st.sampled_from(sorted(p for p in scene.rglob("*") if p.is_file())))
    content = bytearray(path.read_bytes())
    place = data.draw(st.one_of(st.integers(0, 200), st.integers(0, len(content) - 1)))
    content[min(place, len(content) - 1)] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    with contextlib.suppress(FileFormatError, InputError):
        (found,) = find_scenes(scene)
        unit_from_layout(found, 0, tmp_path / "u", Assumptions(robot="h1"))
        read_episode_unit(tmp_path / "u")


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


def test_the_command_converts_to_the_layout_and_back(
    units: list[Path],
    tmp_path: Path,
    inline: None,  # noqa: F811
    caplog: pytest.LogCaptureFixture,
) -> None:
    assemble_dataset(units, tmp_path / "set", provenance={"a": 1}, licence="mit", title="Set")
    words = tmp_path / "train.json"
    words.write_text(
        json.dumps({"instruction_vocab": {"word_list": ["<pad>", "<unk>", "sofa", "walk", "."]}})
    )
    call = [
        "convert",
        str(tmp_path / "set"),
        "--to",
        "n1",
        "--out",
        str(tmp_path / "there"),
        "--every-frame",
    ]
    assert cli.main([*call, "--vocabulary", str(words), "--scan", "r2r_flash"]) == 0
    root = tmp_path / "there" / "n1" / "set"
    tasks = [t for key in loader_keys(root, ["r2r_flash"]) for t in loader_data(root, key)["tasks"]]
    assert tasks[0]["instruction_tokens"][:3] == [3, 1, 1]
    assert cli.main(["verify", str(tmp_path / "there")]) == 0
    back = ["convert", str(root), "--to", "lerobot", "--out", str(tmp_path / "back")]
    assert cli.main(back) == 0
    assert cli.main(["verify", str(tmp_path / "back")]) == 0
    break_layout(root / "r2r_flash" / "two-rooms", "cut colour")
    assert cli.main(["verify", str(tmp_path / "there")]) == 1
    assert open_dataset(tmp_path / "back/lerobot/set").facts == open_dataset(tmp_path / "set").facts
    assert "images of 96 × 64" in caplog.text
    with pytest.raises(FileFormatError, match="no instruction_vocab"):
        read_vocabulary(tmp_path / "set" / "meta" / "info.json")


def test_the_command_converts_theirs_and_quarantines_what_is_damaged(
    layout: Path,
    tmp_path: Path,
    inline: None,  # noqa: F811
    caplog: pytest.LogCaptureFixture,
) -> None:
    scene = make_foreign(layout) / "r2r" / "two-rooms"
    break_layout(scene, "cut colour")
    out = tmp_path / "out"
    call = ["convert", str(layout), "--to", "lerobot", "--out", str(out), "--max-failed", "1"]
    assert cli.main([*call, "--licence", "cc-by-nc-sa-4.0"]) == 0
    (bad,) = [r for r in Ledger(out).rows() if r.status == "quarantined"]
    assert "episode_000000.npy" in bad.error["reason"]
    opened = open_dataset(out / "lerobot" / "n1")
    assert opened.episodes == (0, 1) and opened.facts.licence == "cc-by-nc-sa-4.0"
    converted = opened.facts.provenance["converted"]
    assert converted["assumed"]["hfov_deg"] == 90.0 and "goal" in converted["missing"]
    assert "2 episodes say 30 frames/s" in caplog.text
    call = ["convert", str(layout), "--to", "mcap", "--out", str(tmp_path / "m")]
    assert cli.main([*call, "--max-failed", "1"]) == 0
    made = sorted((tmp_path / "m" / "mcap" / "n1").iterdir())
    assert [p.name for p in made] == ["r2r-two-rooms-000001.mcap", "r2r-two-rooms-000002.mcap"]
    topics = decode(made[0])
    assert "/imu" not in topics and len(topics["/camera/rgb"]) == 13


@pytest.mark.parametrize(
    "name",
    ["info.json", "tasks.jsonl", "episodes.jsonl", "episodes_stats.jsonl", "vlnpe_episodes.jsonl"],
)
def test_changed_metadata_is_converted_again(layout: Path, tmp_path: Path, name: str) -> None:
    def keys() -> list[str]:
        (items,) = unit_items(
            detect(layout), tmp_path, Options("mit", None, Assumptions())
        ).values()
        return [item.key for item in items]

    before = keys()
    assert before == keys()
    path = layout / "r2r" / "two-rooms" / "meta" / name
    path.write_text(path.read_text() + "\n")
    assert not set(before) & set(keys())


def test_other_frame_rates_have_steps_but_no_actions(tmp_path: Path, inline: None) -> None:  # noqa: F811
    unit = write_unit(tmp_path, make_rollout(1.0), frames_per_second=10)
    assemble_dataset([unit], tmp_path / "set", provenance={}, licence="mit", title="Set")
    out = tmp_path / "out"
    call = ["convert", str(tmp_path / "set"), "--to", "n1", "--out", str(out)]
    assert cli.main(call) == 0
    assert cli.main([*call, "--every-frame"]) == 1
    (bad,) = [r for r in Ledger(out).rows() if r.status == "quarantined"]
    assert "no action.discrete at 10 frames/s; valid: 4" in bad.error["reason"]
