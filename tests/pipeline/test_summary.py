"""What `collect` prints at its end fits a terminal and leaves nothing out."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from vlnpe.pipeline.engine.ledger import Ledger, Row
from vlnpe.pipeline.report.gather import RobotRow, shared_paths_note
from vlnpe.pipeline.summary import elided, legend, looking_commands, robot_table


def robot(**values: Any) -> RobotRow:
    plain: dict[Any, Any] = {int: 0, float: 100.0, float | None: 12.34}
    known = {f.name: plain.get(f.type, "aliengo") for f in fields(RobotRow)}
    return RobotRow(**{**known, "driven": "path", **values})


def test_the_table_of_a_common_run_fits_80_columns() -> None:
    header, line = robot_table([robot(episodes=480, instructions=1440)]).splitlines()
    assert len(header) == len(line) <= 80
    assert line.split()[:5] == ["aliengo", "path", "480", "1440", "100.0%"]


def test_the_widest_table_fits_100_columns_and_tells_what_went_wrong() -> None:
    counts = {"falls": 2, "down": 1, "stuck": 3, "timeouts": 4, "stopped_far": 5, "stopped_near": 9}
    counts |= {"blocked_starts": 6, "collisions": 7, "diverged": 8}
    names = {"robot": "a_robot_of_my_own_make", "driven": "speed, open loop, 50 steps, seed 12"}
    lines = robot_table([robot(**counts, **names), robot(ne=None)]).splitlines()
    assert max(map(len, lines)) <= 100
    told = " ".join(" ".join(lines[2:-1]).split())
    for words in (
        "2 fell (1 down a second later)",
        "3 stuck",
        "4 out of time",
        "5 stopped far",
        "9 stopped near",
    ):
        assert words in told
    for words in ("6 blocked at the start", "7 touched", "8 diverged"):
        assert words in told
    assert "–" in lines[-1] and "fell" not in lines[-1]


def test_the_legend_explains_what_is_shown() -> None:
    assert "Beneath a robot" in legend([robot(), robot(stuck=1)])
    assert "Beneath a robot" not in legend([robot(), robot()])
    assert "human" not in legend([robot()])
    assert "human" in legend([robot(), robot(controller="human")])


def walk(ledger: Ledger, crew: str, path: str, success: bool, **facts: Any) -> None:
    name, controller = crew.split("/")
    metrics = {"success": success, "oracle_success": success, "spl": success, "fall": False}
    metrics |= {"stuck": False, "trajectory_length_m": 1.0, "navigation_error_m": 1.0, "ndtw": 1.0}
    facts |= {"robot": name, "controller": controller, "metrics": metrics, "contacts": []}
    facts |= {"end_reason": "success" if success else "timeout"}
    ledger.add(Row("replay", f"{crew}/{path}", "k", "done", facts=facts))


def test_rows_of_different_paths_are_compared_on_those_that_all_walked(tmp_path: Path) -> None:
    ledger = Ledger(tmp_path)
    for path, success in (("a", True), ("b", False)):
        walk(ledger, "h1/path", path, success, seed=0)
    assert shared_paths_note(ledger) == ""
    walk(ledger, "aliengo/path", "b", True, seed=0)
    assert shared_paths_note(ledger) == (
        "The rows are averages over different paths. SR % on the 1 path that all walked: "
        "aliengo path: 100.0, h1 path: 0.0."
    )
    ledger.add(Row("replay", "aliengo/path/a", "k", "quarantined", error={"type": "DivergedError"}))
    assert shared_paths_note(ledger) == ""  # it walked that path, too
    walk(ledger, "jetbot/path", "c", True, seed=0)
    assert shared_paths_note(ledger) == "The rows are averages over different paths."
    # Another seed may have sampled other paths of the same names.
    other = Ledger(tmp_path / "other")
    other.root.mkdir()
    for seed, crew in enumerate(("h1/path", "h1/path-seed-1")):
        walk(other, crew, "a", True, seed=seed)
    assert shared_paths_note(other) == "The rows are averages over different paths."


def test_without_a_display_the_viewer_is_served(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ledger = Ledger(tmp_path)
    ledger.add(Row("dataset", "d", "", "done", outputs=("lerobot/d",)))
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    assert "--mode distant" in looking_commands(ledger, tmp_path / "index.html")
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
    assert "--mode distant" not in looking_commands(ledger, tmp_path / "index.html")


def test_long_names_lose_their_middle() -> None:
    assert elided("aliengo", 7) == "aliengo"
    assert elided("speed, open loop, seed 12", 13) == "speed,…eed 12"


def test_every_dataset_has_its_commands(tmp_path: Path) -> None:
    names = [f"aliengo-path-ego-256x256-90deg-{k:02}" for k in range(15)]
    ledger = Ledger(tmp_path)

    def collected(name: str) -> str:
        ledger.add(Row("dataset", name, "", "done", outputs=(f"lerobot/{name}",)))
        for number in range(3):
            file = f"mcap/{name}/{number}.mcap"
            ledger.add(Row("mcap", f"{name}/{number}", "", "done", outputs=(file,)))
        return looking_commands(ledger, tmp_path / "index.html")

    first = collected(names[0])
    assert "and 2 more beside it" in first
    collected(names[1])
    lines = collected(names[2]).splitlines()
    for name in names[:3]:
        assert sum(f"--root {tmp_path / 'lerobot' / name} " in line for line in lines) == 1
        assert sum(str(tmp_path / "mcap" / name / "0.mcap") in line for line in lines) == 1
    assert any("and 6 more beside these" in line for line in lines)
    many = [collected(name) for name in names][-1]
    assert many.count("lerobot-dataset-viz") == 12 and "… and 3 more datasets" in many
