"""Later commands in the same folder: what they explain, keep, and run alone."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from tests.support.runs import tiny_run
from vlnpe.collectors.controllers import SpeedConfig
from vlnpe.collectors.replay.replay import ReplayConfig
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.vlnce.files import read_episodes
from vlnpe.pipeline.engine.ledger import Ledger, Row
from vlnpe.pipeline.report.gather import driven, robot_rows
from vlnpe.pipeline.stages.rollouts.replay_items import item_names, label_of
from vlnpe.pipeline.stages.rollouts.replay_job import actions

pytestmark = pytest.mark.chain

SPEED = ReplayConfig(robot="aliengo", controller="speed")
CLOSED = replace(SPEED, speed=replace(SpeedConfig(), end_on_displacement=True))


def walked(ledger: Ledger, config: ReplayConfig) -> str:
    """Record a rollout of a robot under these settings; return the name it is kept under."""
    label = label_of(ledger, config)
    facts = {"robot": config.robot, "controller": config.controller, "seed": config.seed}
    facts |= {"actions": actions(config), "state": config.state}
    ledger.add(Row("replay", f"{config.robot}/{label}/e", "k", "done", facts=facts))
    return label


def test_rollouts_of_other_seeds_and_actions_are_kept_apart(tmp_path: Path):
    ledger = Ledger(tmp_path)
    assert walked(ledger, SPEED) == "speed"
    assert walked(ledger, CLOSED) == "speed-loop-closed"
    assert walked(ledger, replace(CLOSED, seed=1)) == "speed-loop-closed-seed-1"
    slow = replace(SPEED, speed=replace(SpeedConfig(), steps_per_action=100))
    assert walked(ledger, slow) == "speed-steps-100"
    path = replace(SPEED, controller="path", seed=5)
    assert walked(ledger, path) == "path"
    assert walked(ledger, replace(path, state="estimated")) == "path-state-estimated"
    # Coming back finds what is there; where the closed loop was first, it has the plain name.
    assert [walked(ledger, c) for c in (SPEED, CLOSED)] == ["speed", "speed-loop-closed"]
    other = Ledger(tmp_path / "other")
    other.root.mkdir()
    assert [walked(other, c) for c in (CLOSED, SPEED)] == ["speed", "speed-loop-open"]


def test_the_controller_column_says_open_or_closed_loop():
    def description(config: ReplayConfig, seeds: bool = False) -> str:
        facts = {"actions": actions(config), "seed": config.seed, "state": config.state}
        return driven(config.controller, [facts], seeds)

    assert description(SPEED) == "speed, open loop, 50 steps"
    assert description(CLOSED) == "speed, closed loop"
    assert description(replace(SPEED, controller="path", seed=3), seeds=True) == "path, seed 3"
    assert description(replace(CLOSED, state="estimated")) == "speed, closed loop, estimated state"


def test_another_seed_adds_rows_to_the_report(scan: Path, finished: Path, tmp_path: Path):
    run = shutil.copytree(finished, tmp_path / "run")
    done = tiny_run.collect(scan, run, "--seed", 1, "--explain")
    assert done.returncode == 0, done.stderr[-2000:]
    assert "repair scan is reused (unchanged)" in done.stderr
    assert "sample scan runs: seed: 0 → 1" in done.stderr
    rows = robot_rows(Ledger(run))
    assert [(r.robot, r.driven, r.episodes) for r in rows] == [
        ("vlnce", "flash, seed 0", 2), ("vlnce", "flash, seed 1", 2),
    ]  # fmt: skip
    page = (run / "report" / "index.html").read_text()
    assert "flash, seed 0" in page and "flash, seed 1" in page
    assert len(list((run / "lerobot").iterdir())) == 2
    checked = tiny_run.vlnpe("verify", run)
    assert checked.returncode == 0, checked.stdout


def test_a_quarantined_item_is_run_alone_by_the_command_that_is_kept(
    scan: Path, finished: Path, tmp_path: Path
):
    run = shutil.copytree(finished, tmp_path / "run")
    item = Ledger(run).rows("render")[0].item
    rollout = run / "rollouts" / "vlnce" / "flash" / f"{item.rsplit('/', 1)[1]}.mcap"
    sound = rollout.read_bytes()
    rollout.write_bytes(sound[:200].ljust(len(sound), b"\0"))  # another size would be noticed
    shutil.rmtree(run / "frames" / item)
    broken = tiny_run.collect(scan, run)
    assert broken.returncode == 1 and f"render {item} quarantined" in broken.stderr
    error = Ledger(run).row("render", item).error  # type: ignore[union-attr]
    text = (run / error["traceback"]).read_text()
    assert "Traceback" in text and "read_rollout" in text and error["command"] in text

    failed = tiny_run.printed(error["command"])
    assert failed.returncode == 1 and "read_rollout" in failed.stderr
    assert Ledger(run).row("render", item).status == "quarantined"  # type: ignore[union-attr]
    rollout.write_bytes(sound)
    fixed = tiny_run.printed(error["command"])
    assert fixed.returncode == 0 and f"render {item}: done" in fixed.stderr
    assert not (run / error["traceback"]).exists()


def aliengo_joins(scan: Path, run: Path, *options: str) -> subprocess.CompletedProcess[str]:
    done = tiny_run.collect(scan, run, "--robot", "aliengo", "--controller", "flash", *options)
    assert done.returncode == 0, done.stderr[-2000:]
    return done


def paths_walked(run: Path) -> dict[str, int]:
    return {row.robot: row.episodes for row in robot_rows(Ledger(run))}


def test_a_robot_on_fewer_of_the_same_paths_joins_the_others(
    scan: Path, finished: Path, tmp_path: Path
):
    run = shutil.copytree(finished, tmp_path / "run")
    done = aliengo_joins(scan, run, "--episodes", "1")
    assert paths_walked(run) == {"aliengo": 1, "vlnce": 2}
    assert "Left out" not in done.stdout
    assert "now hold 1 of the 2 paths" in done.stderr
    assert "SR % on the 1 path that all walked: " in " ".join(done.stdout.split())
    page = (run / "report" / "index.html").read_text()
    assert "that all walked" in page and "2 paths were walked: some are of earlier runs" in page
    for dataset in (run / "lerobot").iterdir():
        assert f"<h3>{dataset.name}</h3>" in page and f"--root {dataset} " in done.stdout
    own = tiny_run.collect(scan, run, "--episodes", "1", "--json")
    stages = json.loads(own.stdout.splitlines()[-1])["stages"]
    assert (stages["replay"]["done"], stages["replay"]["reused"]) == (0, 1)


def test_a_robot_on_other_paths_is_left_out_and_the_printed_command_brings_it_back(
    scan: Path, finished: Path, tmp_path: Path
):
    run = shutil.copytree(finished, tmp_path / "run")
    done = aliengo_joins(scan, run, "--heading", "random")
    assert paths_walked(run) == {"aliengo": 2}
    assert "Left out: vlnce flash, 2 paths." in done.stdout
    page = (run / "report" / "index.html").read_text()
    assert "left out here" in page and "vlnce flash (2 paths; vlnce-flash-ego" in page
    (command,) = re.findall("^  (cd .*collect.*)$", done.stdout, re.MULTILINE)
    back = tiny_run.printed(f"{command} --explain")
    assert back.returncode == 0, back.stderr[-2000:]
    # It walks again, and which field of the paths has changed is said.
    assert re.search(r"replay vlnce.* runs: .*Episode\.start_yaw_rad: \S+ → \S+", back.stderr)
    assert paths_walked(run) == {"aliengo": 2, "vlnce": 2}
    assert "Left out" not in back.stdout


def test_what_a_recipe_lacks_is_collected_by_the_commands_that_mix_prints(
    scan: Path, finished: Path, tmp_path: Path
):
    shutil.copytree(finished, tmp_path / "runs" / "run")
    sources = {
        "day": {"robots": ["vlnce"], "lights": ["DL5000"]},
        "night": {"robots": ["vlnce"], "lights": ["DL300"]},
        "scanned": {"robots": ["vlnce"]},
    }
    mixtures = {"all": list(sources), "night": ["night"]}
    recipe = {"recipe": 1, "title": "t", "sources": sources, "mixtures": mixtures}
    (tmp_path / "recipe.yaml").write_text(json.dumps(recipe))
    asked = ("mix", tmp_path / "recipe.yaml", "--data", tmp_path / "runs", "--dry-run")
    lacking = tiny_run.vlnpe(*asked)
    assert lacking.returncode == 2
    found = re.findall("^  (.*) # +(.*)$", lacking.stderr, re.MULTILINE)
    assert [name for _, name in found] == ["day", "night"], lacking.stderr
    for command, _ in found:
        # The run has moved since it was collected.
        done = tiny_run.printed(command.replace(str(finished), str(tmp_path / "runs/run")))
        assert done.returncode == 0, done.stderr[-2000:]
    shown = tiny_run.vlnpe(*asked)
    assert shown.returncode == 0, shown.stderr


@pytest.mark.parametrize(
    ("ids", "names"),
    [
        (("a/b", "a-b"), ["a%2Fb", "a-b"]),
        (("Hall", "hall"), ["%48all", "hall"]),
        (("1", "1"), ["train-1", "train-1%7E2"]),
    ],
)
def test_episodes_whose_ids_make_one_file_name_are_both_kept(finished: Path, ids, names):
    first, second = read_episodes(finished / "episodes" / "train.json.gz")[:2]
    named: list[Episode] = [replace(first, episode_id=ids[0]), replace(second, episode_id=ids[1])]
    found = item_names(named)
    assert len({name.casefold() for name in found}) == 2
    assert found == names or ids == ("1", "1")
