"""`vlnpe robots`: the list, the pictures, and the exported folder."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from vlnpe.collectors.locomotion.runtime.policy import GaitPolicy
from vlnpe.collectors.locomotion.trials.gates import GATES
from vlnpe.collectors.robots import ROBOTS, get_robot
from vlnpe.collectors.robots.registry import FOLDERS
from vlnpe.formats.core.errors import InputError
from vlnpe.pipeline import robot_sheet
from vlnpe.pipeline.cli import main
from vlnpe.pipeline.robot_sheet import details, sheet_of, table
from vlnpe.rendering.figures.portraits import StandingRobot, turntable, walking_strip
from vlnpe.rendering.figures.stroll import stroll
from vlnpe.rendering.figures.studio import make_studio

pytestmark = pytest.mark.chain


def run_json(capsys: pytest.CaptureFixture, *arguments: object) -> dict:
    assert main(["robots", *map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out.splitlines()[-1])


def test_it_lists_every_robot_with_its_facts(capsys: pytest.CaptureFixture):
    rows = {row["name"]: row for row in run_json(capsys)["robots"]}
    assert list(rows) == [*ROBOTS, *FOLDERS]
    for name, row in rows.items():
        robot = get_robot(name)
        assert row["mass_kg"] == pytest.approx(robot.mass_kg, abs=1e-3)
        assert row["height_m"] >= row["camera_height_m"] - 0.05
        assert row["camera_pitch_down_deg"] == robot.camera.pitch_down_deg
        assert row["vx_m_s"] == list(robot.command_limits.vx_m_s)
        assert row["footprint_radius_m"] == robot.footprint_radius_m
    assert rows["aliengo"]["height_m"] == pytest.approx(0.49, abs=0.03)
    assert rows["jetbot"]["camera_height_m"] == pytest.approx(1.2, abs=0.001)
    assert rows["vlnce"]["controllers"] == ["flash"]
    assert rows["jetbot"]["controllers"] == ["path", "speed", "flash"]
    assert rows["aliengo"]["samples"] > 1e6
    assert {gate["name"] for gate in rows["aliengo"]["gates"]} == {gate.name for gate in GATES}
    assert main(["robots"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[: lines.index("")]] == ["robot", *rows]


def test_an_unmeasured_gate_is_marked(monkeypatch: pytest.MonkeyPatch):
    robot = get_robot("aliengo")
    policy = GaitPolicy.load(robot)
    for evaluation, summary in (
        ({}, "not measured"),
        ({"pushes": {"survived": 0.5}}, f"0 of 1 passed, {len(GATES) - 1} not measured"),
        ({"pushes": {"survived": 1.0}}, f"1 of 1 passed, {len(GATES) - 1} not measured"),
        ({"pushes": {"survived": math.nan}}, "not measured"),
    ):
        changed = policy.changed(robot, replace(policy.card, evaluation=evaluation))
        monkeypatch.setattr(robot_sheet.GaitPolicy, "load", lambda robot, given=changed: given)
        sheet = sheet_of(robot)
        assert sheet.gate_summary == summary
        assert summary in table([sheet])
        json.dumps([dict(gate) for gate in sheet.gates], allow_nan=False)
        assert "not measured" in details(sheet)


@pytest.mark.parametrize("training", [{}, {"anticipation": "some"}, {"anticipation": {}}])
def test_only_a_gait_that_anticipates_says_so(monkeypatch: pytest.MonkeyPatch, training: dict):
    robot = get_robot("g1")
    policy = GaitPolicy.load(robot)
    assert "anticipates delays: actions may be 70 ms late" in details(sheet_of(robot))
    changed = policy.changed(robot, replace(policy.card, training=training))
    monkeypatch.setattr(robot_sheet.GaitPolicy, "load", lambda robot: changed)
    assert "anticipates" not in details(sheet_of(robot))


def test_a_named_robot_is_described_in_full(capsys: pytest.CaptureFixture):
    assert main(["robots", "aliengo", "jetbot@2"]) == 0
    text = capsys.readouterr().out
    for gate in GATES:
        assert gate.name in text
    for source in (*get_robot("aliengo").sources, *get_robot("jetbot").sources):
        assert source in text
    assert "million samples" in text


@pytest.mark.parametrize("arguments", [["nobody"], ["--view", "nobody"], ["--export", "nobody"]])
def test_unknown_robots_list_the_valid_ones(
    capsys: pytest.CaptureFixture, tmp_path: Path, arguments: list[str]
):
    assert main(["robots", *arguments, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    for name in (*ROBOTS, "jetbot@<scale>", "a folder with a robot.toml"):
        assert name in error
    assert not (tmp_path / "out").exists()


def test_it_writes_pictures_and_says_when_there_is_no_walk(
    capsys: pytest.CaptureFixture, tmp_path: Path
):
    value = run_json(capsys, "--view", "vlnce", "--out", tmp_path)
    assert value["pictures"] == [str(tmp_path / "vlnce-turntable.png")]
    assert "cannot walk" in value["note"]
    picture = np.asarray(Image.open(tmp_path / "vlnce-turntable.png"))
    assert picture.shape[0] > 500
    assert picture.shape[1] > 500


def test_a_turntable_shows_all_sides_and_a_strip_two_cycles():
    robot = get_robot("jetbot")
    studio = make_studio(robot)
    picture = turntable(studio, robot, tile_px2=12_000)
    # Below the title: two rows of four views, each of another side.
    width = picture.shape[1] // 4
    height = round(12_000 / width)
    views = picture[-2 * height :]
    tiles = [tile for row in np.split(views, 2) for tile in np.split(row, 4, axis=1)]
    assert len({tile.tobytes() for tile in tiles}) == 8
    yellow = [((t[..., 0] > 150) & (t[..., 2] < 90)).mean() for t in tiles]
    assert min(yellow) > 0.002  # a wheel's hub is seen from every side

    walk = stroll(robot)
    strip = walking_strip(studio, robot, walk, tile_px2=12_000)
    width = strip.shape[1] // 6
    height = round(12_000 / width)
    moments = [t for row in np.split(strip[-2 * height :], 2) for t in np.split(row, 6, axis=1)]
    assert len({moment.tobytes() for moment in moments}) == 12
    # The wheels turn twice.
    turned = walk.joint_rad[-1] - walk.joint_rad[0]
    np.testing.assert_allclose(turned, 4 * np.pi, rtol=0.02)


@pytest.mark.parametrize("name", ["aliengo", "jetbot", "jetbot@1"])
def test_a_stroll_is_steady_and_straight(name: str):
    robot = get_robot(name)
    walk = stroll(robot)
    speed = min(0.8, robot.command_limits.vx_m_s[1])
    moved = walk.position_m[-1] - walk.position_m[0]
    assert moved[0] / walk.time_s[-1] == pytest.approx(speed, rel=0.12)
    assert abs(moved[1]) < 0.1 * moved[0]
    assert walk.joint_rad.shape == (len(walk.time_s), len(robot.joints))
    assert walk.position_m[:, 2] == pytest.approx(robot.base_height_m, rel=0.2)


def test_an_agent_without_joints_cannot_stroll():
    with pytest.raises(InputError, match="vlnce has no joints"):
        stroll(get_robot("vlnce"))


def test_heights_are_those_of_the_real_ones():
    heights = {name: StandingRobot.of(robot).height_m for name, robot in ROBOTS.items()}
    assert heights["h1"] == pytest.approx(1.8, abs=0.08)
    assert heights["g1"] == pytest.approx(1.32, abs=0.05)
    assert StandingRobot.of(get_robot("jetbot@1")).height_m == pytest.approx(0.116, abs=0.002)


def test_an_export_never_replaces_a_robot(capsys: pytest.CaptureFixture, tmp_path: Path):
    out = tmp_path / "mycart"
    run_json(capsys, "--export", "jetbot", "--out", out)
    facts = out / "robot.toml"
    edited = facts.read_text() + "# mine\n"
    facts.write_text(edited)
    assert main(["robots", "--export", "jetbot", "--out", str(out)]) == 2
    assert "already exists" in capsys.readouterr().err
    assert facts.read_text() == edited


def test_a_robot_that_cannot_be_used_ends_with_code_2(
    capsys: pytest.CaptureFixture, tmp_path: Path
):
    out = tmp_path / "mydog"
    run_json(capsys, "--export", "aliengo", "--out", out)
    network = out / "policy.safetensors"
    network.write_bytes(network.read_bytes()[:1000])
    assert main(["robots", str(out)]) == 2
    assert "policy.safetensors" in capsys.readouterr().out


def test_an_exported_robot_is_a_robot(capsys: pytest.CaptureFixture, tmp_path: Path):
    out = tmp_path / "mydog"
    assert run_json(capsys, "--export", "aliengo", "--out", out) == {
        "out": str(out),
        "robot": "mydog",
    }
    assert sorted(p.name for p in out.iterdir()) == [
        "model.xml",
        "policy.json",
        "policy.safetensors",
        "robot.toml",
    ]
    (row,) = run_json(capsys, out)["robots"]
    assert row["name"] == "mydog"
    assert row["problem"] == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--export", "aliengo"], "requires --out"),
        (["--export", "aliengo", "--out", "h1"], "h1 is a built-in robot"),
        (["--export", "aliengo", "--out", "my dog"], "letters, digits, - and _"),
        (["--export", "aliengo", "--view", "h1"], "cannot be combined"),
    ],
)
def test_bad_calls_are_refused(
    capsys: pytest.CaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    arguments: list[str],
    message: str,
):
    monkeypatch.chdir(tmp_path)
    assert main(["robots", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
