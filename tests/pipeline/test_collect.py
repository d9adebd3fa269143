"""The whole chain as a user runs it, and its outputs through readers that are not ours."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.support.runs.flips import flipped
from tests.support.scenes import scans
from vlnpe.formats.core.frames import world_to_habitat_position, world_to_habitat_rotation
from vlnpe.formats.mcap.rollout import read_rollout
from vlnpe.formats.vlnce.files import (
    VlnceEpisode,
    VlnceFile,
    VlnceGoal,
    read_episodes,
    write_vlnce,
)
from vlnpe.pipeline.cli import main
from vlnpe.pipeline.engine.ledger import Ledger

pytestmark = pytest.mark.slow

VIEW = "ego-256x256-90deg-baked"
SMALL = "ego-96x72-90deg-baked"
EPISODES = 2
ONE_WORKER = ("--workers", 1)  # starting a second one costs more than it saves here


def vlnpe(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run the command in a fresh process, as a user would."""
    return subprocess.run(
        [sys.executable, "-m", "vlnpe.pipeline.cli", *map(str, arguments)],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
    )


def last_json(done: subprocess.CompletedProcess[str]) -> dict:
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


@pytest.fixture(scope="session")
def run_root(tmp_path_factory) -> Path:
    """One collected run on the built-in scene, shared by the tests below (they only read it)."""
    cwd = tmp_path_factory.mktemp("user")
    done = vlnpe("collect", "--episodes", EPISODES, "--out", "run", cwd=cwd)
    assert done.returncode == 0, done.stderr[-3000:]
    for word in ("LeRobot", "Foxglove", "report", "aliengo"):
        assert word in done.stdout
    return cwd / "run"


def test_every_episode_is_collected_by_walking(run_root):
    rows = Ledger(run_root).rows("replay")
    assert len(rows) == EPISODES
    for row in rows:
        assert row.facts["end_reason"] == "success", row.facts
        assert row.facts["metrics"]["trajectory_length_m"] > 4.5
        rollout = read_rollout(run_root / row.outputs[0])
        # No teleporting: no step of 10 ms moves the base faster than a robot can.
        steps = np.linalg.norm(np.diff(rollout.position_world_m, axis=0), axis=1)
        assert steps.max() < 0.03
        # Feet leave the floor and come down again, each many times.
        lifts = np.abs(np.diff(rollout.foot_contact.astype(int), axis=0)).sum(axis=0)
        assert (lifts > 10).all()


def test_real_lerobot_loads_the_dataset_offline(run_root):
    code = f"""
import json, torch
from vlnpe.datasets.local import open_dataset
from pathlib import Path
ds = open_dataset(Path({str(run_root / "lerobot" / f"aliengo-path-{VIEW}")!r}))
frame = ds[len(ds) // 2]
print(json.dumps({{
    "episodes": ds.num_episodes, "frames": len(ds), "fps": ds.fps, "task": frame["task"],
    "robot": ds.meta.robot_type,
    "shapes": {{k: list(v.shape) for k, v in frame.items() if torch.is_tensor(v)}},
    "farthest": float(frame["observation.images.depth"].max()),
    "rgb_std": float(frame["observation.images.rgb"].std()),
    "last_action": int(ds[int(ds.meta.episodes[0]["dataset_to_index"]) - 1]["action.discrete"]),
}}))
"""
    environment = {**os.environ, "HF_HUB_OFFLINE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False
    )
    seen = last_json(done)
    instructions = {e.instruction for e in read_episodes(run_root / "episodes" / "train.json.gz")}
    assert seen["episodes"] == EPISODES
    assert seen["frames"] > EPISODES * 20
    assert seen["fps"] == 4
    assert seen["task"] in instructions
    assert seen["robot"] == "aliengo"
    assert seen["shapes"]["observation.images.rgb"] == [3, 256, 256]
    assert seen["shapes"]["observation.images.depth"][-2:] == [256, 256]
    assert seen["shapes"]["observation.state"] == [13]
    assert seen["shapes"]["action"] == [3]
    assert 0.1 < seen["farthest"] <= 20
    assert seen["rgb_std"] > 0.02
    assert seen["last_action"] == 0


def test_mcap_opens_in_its_own_reader_with_every_topic(run_root):
    from mcap.reader import make_reader

    files = sorted((run_root / "mcap" / f"aliengo-path-{VIEW}").glob("*.mcap"))
    assert len(files) == EPISODES
    with files[0].open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        schemas = {s.name for s in summary.schemas.values()}
        times = [m.log_time for _, _, m in reader.iter_messages()]
        metadata = list(reader.iter_metadata())
    assert {
        "foxglove.CameraCalibration",
        "foxglove.RawImage",
        "foxglove.FrameTransforms",
        "foxglove.PoseInFrame",
    } <= schemas
    assert schemas & {"foxglove.CompressedImage", "foxglove.CompressedVideo"}
    assert times == sorted(times)
    instructions = {e.instruction for e in read_episodes(run_root / "episodes" / "train.json.gz")}
    assert (
        next(m.metadata["text"] for m in metadata if m.name == "vlnpe.instruction") in instructions
    )


def test_report_is_one_file_with_everything(run_root):
    page = (run_root / "report" / "index.html").read_text()
    loaded = re.findall(r"""(?:src|href)=["']([^"'#]{0,40})""", page)
    assert all(link.startswith("data:") for link in loaded if link)
    for episode in read_episodes(run_root / "episodes" / "train.json.gz"):
        assert episode.episode_id in page
        assert episode.instruction.split(".")[0] in page
    datasets = [folder.name for folder in (run_root / "lerobot").iterdir()]
    assert datasets and all(f"<h3>{name}</h3>" in page for name in datasets)
    # Map, before, after, and a film strip of each dataset.
    assert page.count("data:image/jpeg;base64,") >= 3 + len(datasets)
    for word in ("SPL", "nDTW", "FR", "StR", "Instruction"):
        assert word in page


def times(root: Path) -> dict[Path, int]:
    return {p: p.stat().st_mtime_ns for p in root.rglob("*") if p.is_file()}


def test_running_again_does_nothing_and_one_option_redoes_what_depends_on_it(run_root):
    before = times(run_root)
    again = last_json(
        vlnpe("collect", "--episodes", EPISODES, "--out", run_root, "--json", cwd=run_root)
    )
    assert all(stage["done"] == 0 for stage in again["stages"].values()), again["stages"]
    assert times(run_root) == before
    other = last_json(
        vlnpe(
            *("collect", "--episodes", EPISODES, "--out", run_root, "--json"),
            *("--frames-per-second", 5, *ONE_WORKER),
            cwd=run_root,
        )
    )
    redone = {name for name, stage in other["stages"].items() if stage["done"]}
    # The pictures have a strip of the recorded frames.
    assert redone == {"render", "export", "mcap", "dataset", "pictures", "report"}


def test_verify_finds_a_flipped_byte_in_every_file(run_root):
    sound = vlnpe("verify", run_root, cwd=run_root)
    assert sound.returncode == 0, sound.stdout
    rng = np.random.default_rng(3)
    with flipped(run_root, rng, spare=("manifest.json",)) as damaged:
        broken = vlnpe("verify", run_root, cwd=run_root)
    names = [path.relative_to(run_root).as_posix() for path in damaged]
    assert any(name.endswith("scan.glb") for name in names)
    assert [name for name in names if f"BAD  {name}: " not in broken.stdout] == []
    assert broken.returncode == 1 and "Traceback" not in broken.stderr


def foreign(number: int, path_world_m: np.ndarray, scene: str = "rooms") -> VlnceEpisode:
    """Return an episode as somebody else's VLN-CE file has it, without the keys of vlnpe."""
    path = world_to_habitat_position(path_world_m)
    return VlnceEpisode(
        episode_id=number,
        trajectory_id=number,
        scene_id=f"mp3d/{scene}/{scene}.glb",
        start_position_habitat_m=path[0],
        start_rotation_xyzw=world_to_habitat_rotation(0.0),
        instruction_text="Walk into the next room.",
        instruction_tokens=None,
        goals=(VlnceGoal(path[-1], 3.0),),
        reference_path_habitat_m=path,
    )


def test_vlnce_episodes_are_filtered_aligned_and_walked(tmp_path):
    scan = scans.write_glb(scans.two_rooms(1.0), tmp_path / "rooms.glb")
    path = np.array([[1.0, 2.0, 0.0], [3.0, 2.0, 0.0], [5.0, 2.0, 0.0], [6.5, 2.5, 0.0]])
    stairs = path + np.array([[0.0, 0.0, 0.0]] * 2 + [[0.0, 0.0, 1.4]] * 2)
    outside = np.vstack([[300.0, 0.0, 0.0], path])
    episodes = (
        foreign(1, path),
        foreign(2, stairs),
        foreign(3, outside),
        foreign(4, path, "attic"),
    )
    write_vlnce(tmp_path / "val.json.gz", VlnceFile(tmp_path / "val.json.gz", episodes))
    done = vlnpe(
        *("collect", "--scene", scan, "--camera", "ego:96x72:90"),
        *("--episodes", "val.json.gz", "--out", "run", "--max-failed", 2, "--json", *ONE_WORKER),
        cwd=tmp_path,
    )
    summary = last_json(done)
    walked = read_episodes(tmp_path / "run" / "episodes" / "val.json.gz")
    assert [e.episode_id for e in walked] == ["1"]
    assert walked[0].instruction == "Walk into the next room."
    assert summary["robots"][0]["collected"] == 100.0
    quarantine = json.loads((tmp_path / "run" / "quarantine.json").read_text())
    reasons = {item["item"]: item["reason"] for item in quarantine["items"]}
    assert set(reasons) == {"episode 3", "episode 4"}
    assert "attic" in reasons["episode 4"]
    page = (tmp_path / "run" / "report" / "index.html").read_text()
    assert "dropped 1 episode (1 path)" in page
    assert "attic" in page


def test_another_robot_and_controller_join_a_run_on_the_same_episodes(run_root, tmp_path):
    shutil.copytree(run_root, tmp_path / "run")
    common = ("--episodes", EPISODES, "--out", "run", "--only-success", "--json")
    common += ("--camera", "ego:96x72:90", *ONE_WORKER)
    closed = ("--robot", "jetbot", "--controller", "speed", "--closed-loop")
    first = last_json(vlnpe("collect", *closed, "--light", "baked,CL", *common, cwd=tmp_path))
    walked, drawn = first["stages"]["replay"], first["stages"]["render"]
    assert (walked["done"], walked["reused"]) == (EPISODES, 0)  # once, under any light
    assert drawn["done"] == 2 * EPISODES
    kept = {p.name for p in (tmp_path / "run" / "lerobot").iterdir()}
    assert {f"jetbot-speed-{SMALL}", f"jetbot-speed-{SMALL}".replace("baked", "CL")} <= kept
    # What joined earlier stays, although discrete actions are timed otherwise now.
    done = last_json(
        vlnpe(
            *("collect", "--robot", "aliengo,vlnce", "--controller", "path,flash"),
            *common,
            cwd=tmp_path,
        )
    )
    stages = done["stages"]
    assert (stages["sample"]["done"], stages["replay"]["reused"]) == (0, EPISODES)
    assert stages["replay"]["done"] == 2 * EPISODES
    who = [(r["robot"], r["driven"], r["episodes"]) for r in done["robots"]]
    assert who == [
        ("aliengo", "flash", EPISODES),
        ("aliengo", "path", EPISODES),
        ("jetbot", "speed, closed loop", EPISODES),
        ("vlnce", "flash", EPISODES),
    ]
    rows = Ledger(tmp_path / "run").rows("replay")
    walked = [read_rollout(tmp_path / "run" / row.outputs[0]) for row in rows]
    assert len({str(r.episode) for r in walked}) == EPISODES  # the same for all robots
    ghost = tmp_path / "run" / "lerobot" / f"vlnce-flash-{SMALL}" / "meta" / "info.json"
    assert "observation.joints" not in json.loads(ghost.read_text())["features"]
    page = (tmp_path / "run" / "report" / "index.html").read_text()
    for title in ("aliengo, controller path", "vlnce, controller flash"):
        assert title in page


def test_export_alone_may_keep_depth_as_images(run_root, tmp_path, capsys):
    export = ("export", run_root, "--scenes", run_root / "scenes", "--out", "data")
    last_json(vlnpe(*export, "--depth", "image", "--json", *ONE_WORKER, cwd=tmp_path))
    root = tmp_path / "data" / "lerobot" / f"aliengo-path-{VIEW}"
    info = json.loads((root / "meta" / "info.json").read_text())
    assert info["features"]["observation.images.depth"]["dtype"] == "image"
    assert info["total_episodes"] == EPISODES
    assert not (root / "videos" / "observation.images.depth").exists()
    made = json.loads((root / "meta" / "provenance.json").read_text())
    assert made["scenes"]["apartment-0"]["licence"] == "Apache-2.0"
    assert len(made["policy_sha256"]) == 1 and made["instructions"]["composer"]
    assert made["seeds"]["replay"] == [0] and len(made["config_sha256"]) == 64
    capsys.readouterr()
    assert main(["push", str(root), "--repo", "someone/rooms"]) == 0
    assert "nothing was uploaded" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "valid"),
    [
        (("export", "--depth", "png"), "image, video"),
        (("render", "--rgb-codec", "vp9"), "av1, h264"),
    ],
)
def test_unknown_ways_to_keep_pictures_are_named(run_root, tmp_path, capsys, arguments, valid):
    verb, *options = arguments
    out = tmp_path / "out"
    scenes = ("--scenes", str(run_root / "scenes"), "--out", str(out))
    assert main([verb, str(run_root), *scenes, *options]) == 2
    assert valid in capsys.readouterr().err
    assert not out.exists()
