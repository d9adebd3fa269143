"""Each layout is read as its loaders read it, and holds what the robot did."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from tests.collectors.test_replay import make_episode
from tests.formats.trainers.scene import CAMERA, make_sources
from vlnpe.collectors.replay.replay import ReplayConfig, replay_in
from vlnpe.collectors.replay.world import open_world
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.core.rollout import TURN_STEP_RAD
from vlnpe.formats.lerobot import write_episode_unit
from vlnpe.formats.rendered.discrete_steps import execute, planar_poses
from vlnpe.formats.rendered.folder import read_frame_folder
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.trainers.registry import LAYOUTS
from vlnpe.formats.trainers.subset import SIDECAR_NAME, Subset, write_subset
from vlnpe.formats.trainers.walks import Walk, WalkSource
from vlnpe.formats.video.mp4 import read_rgb_video
from vlnpe.rendering.camera.rollout_views import render_rollout
from vlnpe.rendering.camera.views import CameraOverrides, parse_views
from vlnpe.rendering.registry import make_renderer

Rigged = tuple[dict[str, Path], str]  # units of a walk by camera, and its key
IDS = {"stop": 0, "forward": 1, "left": 2, "right": 3}


def read_frame(path: Path) -> Any:
    return pytest.importorskip("pandas").read_parquet(path)


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> list[WalkSource]:
    return make_sources(tmp_path_factory.mktemp("units"))


def write(name: str, root: Path, sources: list[WalkSource], balance: str = "") -> Path:
    layout = LAYOUTS[name]
    balance = balance or layout.balance or "natural"
    subset = Subset("dogs", balance, "mit", {"fall": 2})
    out = root / name / "dogs" / ("room" if layout.per_scene else "")
    write_subset(layout, out, sources, subset)
    return out


def listed(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def origins(out: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (out / SIDECAR_NAME).read_text().splitlines()]


def ends_m(source: WalkSource, actions: list[int], turn_rad: float = TURN_STEP_RAD) -> float:
    """Distance from where the actions lead to where the robot went."""
    poses = planar_poses(Walk.open(source).rows["observation.state"])
    return float(
        np.hypot(*(execute(np.array(actions), poses[0], turn_rad)[-1, :2] - poses[-1, :2]))
    )


def shown(path: Path, image: np.ndarray) -> bool:
    """Whether a picture shows a frame, but for JPEG's loss."""
    return bool(np.abs(np.asarray(Image.open(path).convert("RGB"), int) - image).mean() < 6)


@pytest.mark.parametrize("name", LAYOUTS)
def test_every_output_leads_back_and_says_what_it_is(
    name: str, sources: list[WalkSource], tmp_path: Path
) -> None:
    out = write(name, tmp_path, sources)
    lines = origins(out)
    assert [line["key"] for line in lines] == [source.key for source in sources]
    for line, source in zip(lines, sources, strict=True):
        walk = Walk.open(source)
        columns = walk.unit.columns
        assert line["instructions"] == list(source.texts)
        for key in ("episode_uid", "scene_id", "robot", "end_reason", "start_position_world_m"):
            assert line[key] == columns[key]
        assert line["source_frames"][-1] == walk.unit.length - 1
    readme = (out / "README.md").read_text()
    assert "3 episodes of the aliengo" in readme and "left out: 2 fall" in readme
    assert "licence: mit" in readme
    assert ("| forward |" in readme) == (name != "navdp")


def test_navila(sources: list[WalkSource], tmp_path: Path) -> None:
    """As LazyVLNCEDataset and the patterns of its evaluator."""
    out = write("navila", tmp_path, sources, balance="natural")
    records = json.loads((out / "annotations.json").read_text())
    assert len({r["video_id"] for r in records}) == len(records)
    assert len({(r["q"], tuple(r["frames"])) for r in records}) == len(records)
    for source in sources:
        frames = read_rgb_video(Walk.open(source).unit.video("observation.images.rgb"))
        (origin,) = (line for line in origins(out) if line["key"] == source.key)
        for text in source.texts:
            own = [r for r in records if r["frames"][0].startswith(source.key) and r["q"] == text]
            actions: list[int] = []
            for record in own:
                assert len(record["frames"]) == len(actions) + 1
                paths = [out / "train" / frame for frame in record["frames"]]
                assert shown(paths[-1], frames[origin["source_frames"][len(actions)]])
                said = record["a"]
                if re.search(r"\bis move forward\b", said):
                    size = int(re.search(r"move forward (\d+) cm", said)[1])  # type: ignore[index]
                    assert size in (25, 50, 75)
                    actions += [1] * (size // 25)
                elif turn := re.search(r"\bis turn (left|right)\b", said):
                    size = int(re.search(rf"turn {turn[1]} (\d+) degree", said)[1])  # type: ignore[index]
                    assert size in (15, 30, 45)
                    actions += [IDS[turn[1]]] * (size // 15)
                else:
                    assert re.search(r"\bstop\b", said)
                    actions.append(0)
            assert actions.count(0) == 1 and actions[-1] == 0
            assert len(list((out / "train" / source.key).iterdir())) == len(actions)
            assert ends_m(source, actions) < 0.5


def test_streamvln(sources: list[WalkSource], tmp_path: Path) -> None:
    """As VLNActionDataset: frames by sorted names, actions shifted by one."""
    out = write("streamvln", tmp_path, sources)
    records = json.loads((out / "annotations.json").read_text())
    for record, source in zip(records, sources, strict=True):
        folder = out / record["video"] / "rgb"
        names = listed(folder)
        assert names[0] == "001.jpg" and len(names) == len(record["actions"]) >= 4
        assert record["actions"][0] == -1 and record["instructions"] == list(source.texts)
        actions = [*record["actions"][1:], 0]
        assert actions.count(0) == 1 and ends_m(source, actions) < 0.5
        frames = read_rgb_video(Walk.open(source).unit.video("observation.images.rgb"))
        assert shown(folder / names[-1], frames[-1]) and shown(folder / names[0], frames[0])
    lines = [json.loads(line) for line in (out / "summary.json").read_text().splitlines()]
    assert [line["scene_id"] for line in lines] == ["two_rooms"] * 3
    assert [line["trajectory_id"] for line in lines] == ["traj0"] * 3


def test_sharegpt(sources: list[WalkSource], tmp_path: Path) -> None:
    """As the trainers of Qwen-VL and LLaMA-Factory: as many images as marks, the newest last."""
    out = write("sharegpt", tmp_path, sources)
    records = json.loads((out / "annotations.json").read_text())
    assert len({r["id"] for r in records}) == len(records)
    words = {"STOP": 0, "MOVE_FORWARD": 1, "TURN_LEFT": 2, "TURN_RIGHT": 3}
    for source in sources:
        for text in source.texts:
            own = [
                r
                for r in records
                if source.key in r["images"][0] and text in r["conversations"][0]["value"]
            ]
            assert [r["images"][-1][-7:] for r in own] == [f"{k:03d}.jpg" for k in range(len(own))]
            for record in own:
                question, answer = record["conversations"]
                assert (question["from"], answer["from"]) == ("human", "gpt")
                assert question["value"].count("<image>") == len(record["images"]) <= 9
                assert record["images"] == sorted(set(record["images"])) == record["image"]
                assert all((out / path).is_file() for path in record["images"])
                assert all(word in question["value"] for word in words)
            assert ends_m(source, [words[r["conversations"][1]["value"]] for r in own]) < 0.5


def test_uni_navid(sources: list[WalkSource], tmp_path: Path) -> None:
    """As LazySupervisedDataset: videos at one frame a second, all of whose frames are taken."""
    out = write("uni-navid", tmp_path, sources, balance="natural")
    records = json.loads((out / "annotations.json").read_text())
    assert len({r["id"] for r in records}) == len(records)
    phrase = "a video of historical observations and an image of the current observation"
    for source in sources:
        own = [r for r in records if source.key in r["id"]]
        per_text = len(own) // len(source.texts)
        actions = []
        for step, record in enumerate(own[:per_text]):
            assert "NAV_ID" in record["id"]
            question, answer = (turn["value"] for turn in record["conversations"])
            assert phrase in question and question.count("<image>") == 1
            video = cv2.VideoCapture(str(out / record["video"]))
            rate, count = video.get(cv2.CAP_PROP_FPS), video.get(cv2.CAP_PROP_FRAME_COUNT)
            taken = list(range(0, int(count), round(rate / 1)))
            assert taken == list(range(step + 1))
            said = answer.split()
            assert set(said) <= set(IDS) and len(said) == min(4, per_text - step)
            actions.append(IDS[said[0]])
        assert actions[-1] == 0 and ends_m(source, actions, 2 * TURN_STEP_RAD) < 0.6
        whole = read_rgb_video(out / own[per_text - 1]["video"])
        half = read_rgb_video(out / own[per_text // 2]["video"])
        np.testing.assert_array_equal(half, whole[: len(half)])


def rigged(
    folders: dict[str, Path], key: str
) -> tuple[Path, str, tuple[str, ...], tuple[Path, ...]]:
    first, *others = folders.values()
    return first, key, ("Walk on.",), tuple(others)


def relative_trajectory(poses: Any, pitch_deg: float) -> np.ndarray:
    """x forward, y left [m] and yaw [rad] (N, 3) from the first, by InternVLA-N1's axes."""
    a = np.deg2rad(pitch_deg)
    level = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    tilt = np.array([[1, 0, 0], [0, np.cos(a), np.sin(a)], [0, -np.sin(a), np.cos(a)]])
    camera = np.eye(4)
    camera[:3, :3] = level @ tilt
    robot = np.matmul(np.asarray(poses), np.linalg.inv(camera))
    relative = np.linalg.inv(robot[0]) @ robot
    yaw = np.arctan2(relative[:, 1, 0], relative[:, 0, 0])
    return np.column_stack([relative[:, :2, 3], yaw])


@pytest.fixture(scope="module")
def rigs(tmp_path_factory: pytest.TempPathFactory, two_rooms: SceneBundle) -> list[Rigged]:
    """Walks of the Aliengo in physics through two rooms, rendered from the rigs of a preset."""
    root = tmp_path_factory.mktemp("rigs")
    world = open_world(two_rooms, 0, get_robot("aliengo"))
    renderer = make_renderer(two_rooms)
    how = {"light": "baked", "renderer": "embree"}
    views = parse_views("rig:n1:96x64", "aliengo", CameraOverrides(), **how)
    result = []
    for number, goal in enumerate([(2.8, 1.3), (5.0, 2.0)]):
        episode = make_episode(two_rooms, (1.2, 1.2), goal, name=f"e{number}")
        walk = replay_in(world, replace(episode, instruction="Walk on."), ReplayConfig())
        folders = {}
        for view in views:
            frames, unit = (root / f"{kind}-{number}-{view.name}" for kind in ("frames", "unit"))
            render_rollout(two_rooms, renderer, walk, view, frames)
            folders[view.camera.name] = unit
            write_episode_unit(unit, walk, read_frame_folder(frames))
        result.append((folders, f"rooms_aliengo_{number:06d}"))
    return result


def check_internvla_view(out: Path, setting: str, sources: list[WalkSource]) -> int:
    """Read a setting as NavPixelGoalDataset; return the number of goals.

    Goals are unprojected with the stored depth and poses alone.
    """
    rgb = out / "videos" / "chunk-000" / f"observation.images.rgb.{setting}"
    pitch = int(re.fullmatch(r"\d+cm_(\d+)deg", setting)[1])  # type: ignore[index]
    meta = json.loads((out / "meta" / "info.json").read_text())
    depth_facts = meta["features"][f"observation.images.depth.{setting}"]["info"]
    k = np.array(meta["camera"]["intrinsics"])
    lines = [json.loads(s) for s in (out / "meta" / "episodes.jsonl").read_text().splitlines()]
    goals = 0
    for line, source in zip(lines, sources, strict=True):
        number = line["episode_index"]
        assert line["tasks"][0].split("<INSTRUCTION_SEP>") == list(source.texts)
        table = read_frame(out / "data" / "chunk-000" / f"episode_{number:06d}.parquet")
        actions = table["action"].tolist()
        assert len(actions) == line["length"] and actions[0] == -1
        assert ends_m(source, [*actions[1:], 0]) < 0.5
        poses = table[f"pose.{setting}"].apply(lambda x: x.tolist()).tolist()
        walk = Walk.open(source)
        frame = walk.steps().frame
        planar = planar_poses(walk.rows["observation.state"])[frame]
        c, s = np.cos(planar[0, 2]), np.sin(planar[0, 2])
        true = np.column_stack(
            [(planar[:, :2] - planar[0, :2]) @ [[c, -s], [s, c]], planar[:, 2] - planar[0, 2]]
        )
        got = relative_trajectory(poses, pitch)
        turned = np.abs(np.angle(np.exp(1j * (got[:, 2] - true[:, 2]))))
        assert turned.max() < 0.05
        assert np.hypot(*(got[:, :2] - true[:, :2]).T).max() < 0.65  # camera 0.3 m ahead of base
        floor_z = walk.unit.columns["start_frame_origin_world_m"][2]
        base = walk.floor_points()[frame]
        assert np.abs(base[:, 2] - floor_z).max() < 0.05  # it stands lower than it walks
        for step in range(len(actions)):
            image = Image.open(rgb / f"episode_{number:06d}_{step}.jpg")
            assert image.size == (CAMERA.width_px, CAMERA.height_px)
            path = Path(str(rgb).replace("rgb", "depth")) / f"episode_{number:06d}_{step}.png"
            stored = np.array(Image.open(path))
            assert stored.dtype == np.uint16 and stored.max() <= 5000
            ahead = table[f"relative_goal_frame_id.{setting}"][step].tolist()
            goal = table[f"goal.{setting}"][step].tolist()
            if ahead == -1:
                assert goal == [-1, -1]
                continue
            goals += 1
            column, row = goal
            z = stored[row, column] * depth_facts["depth_unit_m"]
            point = np.linalg.inv(k) @ [column * z, row * z, z]
            world = np.array(poses[step]) @ [*point, 1.0]
            assert np.linalg.norm(world[:3] - base[step + ahead]) <= 0.25
    return goals


def settings_in(out: Path) -> list[str]:
    return [name.split(".", 3)[3] for name in listed(out / "videos" / "chunk-000") if "rgb" in name]


def test_internvla_n1(sources: list[WalkSource], tmp_path: Path) -> None:
    out = write("internvla-n1", tmp_path, sources)
    assert settings_in(out) == ["40cm_15deg"]
    assert check_internvla_view(out, "40cm_15deg", sources) > 10


def test_internvla_n1_has_all_rigs_in_one_tree(rigs: list[Rigged], tmp_path: Path) -> None:
    """As `data_list` of InternNav names them: height, and the pitches of history and goal."""
    sources = [WalkSource(*rigged(*walk)) for walk in rigs]
    out = write("internvla-n1", tmp_path, sources)
    settings = ["125cm_0deg", "125cm_30deg", "125cm_45deg", "60cm_15deg", "60cm_30deg"]
    assert settings_in(out) == settings
    for height, pitch_1, pitch_2 in ((125, 0, 30), (125, 0, 45), (60, 15, 15), (60, 30, 30)):
        assert {f"{height}cm_{p}deg" for p in (pitch_1, pitch_2)} <= {*settings}
    readme = (out / "README.md").read_text()
    for n, setting in enumerate(settings):
        views = [WalkSource([*folders.values()][n], key, ("Walk on.",)) for folders, key in rigs]
        assert check_internvla_view(out, setting, views) > 5
        poses = Walk.open(views[0]).camera_poses()
        height, pitch = map(int, re.fullmatch(r"(\d+)cm_(\d+)deg", setting).groups())  # type: ignore[union-attr]
        assert 100 * poses[0, 2, 3] == pytest.approx(height, abs=2)
        assert np.rad2deg(np.arcsin(-poses[0, 2, 2])) == pytest.approx(pitch, abs=1.5)
        assert f"rig `{setting}`" in readme
        rgb = read_rgb_video(Walk.open(views[0]).unit.video("observation.images.rgb"))
        first = out / "videos" / "chunk-000" / f"observation.images.rgb.{setting}"
        assert shown(first / "episode_000000_0.jpg", rgb[0])
    assert origins(out)[0]["camera_name"] == ",".join(f"rig:{s}" for s in settings)


def test_views_of_different_walks_are_not_joined(rigs: list[Rigged], tmp_path: Path) -> None:
    (one, key), (other, _) = rigs
    wrong = WalkSource(one["rig:60cm_15deg"], key, ("Go.",), (other["rig:60cm_30deg"],))
    with pytest.raises(FileFormatError, match=r"observation\.state is not"):
        write("internvla-n1", tmp_path, [wrong])
    assert not (tmp_path / "internvla-n1" / "dogs" / "room").exists()


@pytest.mark.parametrize(("rig", "pitch"), [("rig:125cm_45deg", 45), ("rig:60cm_15deg", 15)])
def test_navdp_has_the_mount_of_a_rig(
    rigs: list[Rigged], rig: str, pitch: int, tmp_path: Path
) -> None:
    folders, key = rigs[0]
    scene = write("navdp", tmp_path, [WalkSource(folders[rig], key, ("Walk on.",))])
    table = read_frame(scene / "data" / "chunk-000" / "episode_000000.parquet")
    mounts = np.array([np.stack(m) for m in table["observation.camera_extrinsic"]])
    k = np.stack(table["observation.camera_intrinsic"][0])
    assert 100 * mounts[0, 2, 3] == pytest.approx(int(rig[4:-8]), abs=2)
    assert np.rad2deg(np.arcsin(mounts[:, 2, 2])) == pytest.approx(pitch, abs=5)
    assert np.ptp(mounts[:, 2, 2]) > 0  # it sways
    # What lies on the floor straight ahead is seen where the loader projects it.
    depth = scene / "videos" / "chunk-000" / "observation.images.depth"
    z = np.array(Image.open(depth / listed(depth)[0]), np.uint16) / 10000.0
    h, a, forward = mounts[0, 2, 3], np.deg2rad(pitch), 1.2
    seen = mounts[0, :3, :3] @ np.array([0.0, forward, h])
    column, row = k[:2, 2] + np.array([seen[0], -seen[1]]) / seen[2] * k[0, 0]
    true = forward * np.cos(a) + h * np.sin(a)
    assert z[round(row), round(column)] == pytest.approx(true, abs=0.1)


def test_navdp(sources: list[WalkSource], tmp_path: Path) -> None:
    """As NavDP_Base_Datset: listed folders, sorted names, local points, obstacles by colour."""
    scene = write("navdp", tmp_path, sources)
    root = tmp_path / "navdp"
    assert listed(root) == ["dogs"] and listed(root / "dogs") == ["room"]
    (chunk,) = listed(scene / "data")
    videos = scene / "videos" / chunk
    pictures, depths = (
        [videos / key / name for name in listed(videos / key)]
        for key in ("observation.images.rgb", "observation.images.depth")
    )
    tables = listed(scene / "data" / chunk)
    lines = (scene / "meta" / "episodes_stats.jsonl").read_text().splitlines()
    for number, (line, source) in enumerate(zip(map(json.loads, lines), sources, strict=True)):
        table = read_frame(scene / "data" / chunk / tables[number])
        span = line["image_index"]
        own = pictures[span["min"] : span["max"] + 1]
        assert len(own) == len(table) == Walk.open(source).unit.length
        assert all(f"episode_{number:06d}" in path.name for path in own)
        intrinsic = np.array(
            [row.tolist() for row in table["observation.camera_intrinsic"].tolist()[0]]
        )
        np.testing.assert_allclose(intrinsic.reshape(3, 3), CAMERA.intrinsics)
        mount = np.array(
            [row.tolist() for row in table["observation.camera_extrinsic"].tolist()[0]]
        )
        poses = np.array([np.stack(frame) for frame in table["action"]]).reshape(-1, 4, 4)
        base = poses[0].copy()
        base[:3, :3] = base[:3, :3] @ np.linalg.inv(mount[:3, :3])
        local = (np.linalg.inv(base) @ poses[:, :, 3:])[:, :3, 0]
        local = np.column_stack([local[:, 1], -local[:, 0]])  # x forward, y left
        planar = planar_poses(Walk.open(source).rows["observation.state"])
        ahead = planar[:, :2] + 0.3 * np.stack([np.cos(planar[:, 2]), np.sin(planar[:, 2])], 1)
        np.testing.assert_allclose(local, ahead - ahead[0], atol=0.03)
        # What lies on the floor straight ahead is seen where the loader projects it.
        z = np.array(Image.open(depths[span["min"]]), np.uint16) / 10000.0
        h, forward = mount[2, 3], 1.5
        seen = mount[:3, :3] @ np.array([0.0, forward, h])
        column, row = intrinsic[:2, 2] + np.array([seen[0], -seen[1]]) / seen[2] * intrinsic[0, 0]
        true = forward * np.cos(np.deg2rad(15)) + h * np.sin(np.deg2rad(15))
        assert z[round(row), round(column)] == pytest.approx(true, abs=0.1)
        assert z.max() <= 5.0 and z[z > 0].min() >= 0.1
    trimesh = pytest.importorskip("trimesh")
    cloud = trimesh.load(scene / "meta" / "pointcloud.ply")
    colour = np.asarray(cloud.colors)[:, :3] / 255.0
    assert (np.abs(colour - [0, 0, 0.5]).sum(axis=1) < 0.05).all() and len(cloud.vertices) > 100


@pytest.mark.parametrize(
    ("name", "per_metre", "far_m"), [("internvla-n1", 1000, 5), ("navdp", 10_000, 5)]
)
def test_depth_is_read_back_to_metres(
    name: str, per_metre: int, far_m: float, sources: list[WalkSource], tmp_path: Path
) -> None:
    out = write(name, tmp_path, sources)
    features = json.loads((out / "meta" / "info.json").read_text())["features"]
    (facts,) = (f["info"] for key, f in features.items() if ".depth" in key)
    assert facts["depth_unit_m"] * per_metre == pytest.approx(1.0)
    folder = next(out.glob("videos/chunk-000/observation.images.depth*"))
    walk = Walk.open(sources[0])
    frames = origins(out)[0]["source_frames"]
    depth_m, codes = walk.depth_codes(np.array(frames))
    true = [depth_m[image] for image in codes]
    for path in folder.glob("episode_000000_*"):
        k = int(path.stem.rsplit("_", 1)[1])
        read = np.array(Image.open(path)) * facts["depth_unit_m"]
        measured = (true[k] > 0.1) & (true[k] < far_m - 0.01)
        np.testing.assert_allclose(read[measured], true[k][measured], atol=0.6 / per_metre)
        beyond = true[k] > far_m + 0.01
        assert set(np.unique(read[beyond])) <= ({0.0} if name == "navdp" else {far_m})
