"""Episodes that go wrong, all the way: their labels, the report's clips, what diverged."""

import base64
import io
import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from scipy.spatial.distance import cdist

from tests.collectors.test_replay import make_episode
from tests.support.runs.work import InlineWorkers
from tests.support.scenes.rooms import write_two_rooms
from vlnpe.collectors.physics.outcome import OutcomeConfig
from vlnpe.collectors.replay.replay import ReplayConfig
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.geometry import resample
from vlnpe.formats.mcap.rollout import read_rollout
from vlnpe.pipeline.cli import main
from vlnpe.pipeline.context import open_context
from vlnpe.pipeline.engine.ledger import Ledger, Row
from vlnpe.pipeline.engine.run_folder import RunFolder
from vlnpe.pipeline.engine.work import WorkItem
from vlnpe.pipeline.execution.runner import run_stage
from vlnpe.pipeline.options.running import Running
from vlnpe.pipeline.report import items as report_items
from vlnpe.pipeline.report.failures import failure_figures
from vlnpe.pipeline.report.gather import robot_rows
from vlnpe.pipeline.stages.rollouts import replay_items
from vlnpe.pipeline.stages.rollouts.replay_job import ReplayJob, Walker

DATASET = "aliengo-path-ego-64x48-90deg-baked"
OUTCOMES = {
    "good": OutcomeConfig(),
    "slow": OutcomeConfig(timeout_factor=0.2),
    "mad": OutcomeConfig(diverged_speed=6.0),  # any step is faster than that
}


@pytest.fixture(scope="module", autouse=True)
def _inline() -> Iterator[None]:
    """Work in this process: a worker takes seconds to start."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vlnpe.pipeline.execution.settings.Workers", InlineWorkers)
        yield


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run on the two rooms in which one episode arrives, one does not, and one explodes."""
    root = tmp_path_factory.mktemp("outcomes") / "run"
    with open_context(root, Running(workers=1)) as context:
        folder = RunFolder(context.ledger.root)
        bundle = write_two_rooms(folder.scenes / "two_rooms")
        facts = {
            "levels": 1,
            "triangles": 12,
            "warnings": [],
            **{"holes_filled": 0, "holes_left": {}, "floor_before_m2": 32, "floor_after_m2": 32},
        }
        for name in ("before.png", "after.png"):
            (bundle.root / name).write_bytes(PIXEL)
        scene = Row("repair", "two_rooms", "k", "done", facts=facts, outputs=("scenes/two_rooms",))
        context.ledger.add(scene)
        items: list[WorkItem] = []
        for name, outcome in OUTCOMES.items():
            episode = make_episode(bundle, (2.6, 2.0), (5.4, 2.0), name=name)
            walker = Walker(get_robot("aliengo"), ReplayConfig(outcome=outcome))
            items += replay_items.items(
                [episode],
                {"two_rooms": scene},
                folder.scenes,
                folder.rollouts,
                folder.models,
                walker,
            )
        run_stage(context, replay_items.STAGE, items)
        report_items.write(folder, context, [])
    return root


PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)


def test_a_diverged_episode_is_quarantined_with_its_state_and_counted(root: Path) -> None:
    ledger = Ledger(root)
    row = ledger.row("replay", "aliengo/path/mad")
    assert row is not None and row.status == "quarantined"
    assert "diverged" in row.error["reason"]
    folder = root / "rollouts" / "aliengo" / "path"
    assert sorted(p.name for p in folder.iterdir()) == [
        "good.mcap",
        "mad.diverged.json",
        "slow.mcap",
    ]
    dump = json.loads((folder / "mad.diverged.json").read_text())
    state = dump["facts"]["diverged_state"]
    assert len(state["qpos"]) == 7 + 12
    assert len(state["qvel"]) == 6 + 12
    assert all(np.isfinite(float(v)) for v in state["ctrl"])
    assert (dump["episode"], dump["config"]["robot"]) == ("mad", "aliengo")
    (numbers,) = robot_rows(ledger)
    assert (numbers.episodes, numbers.diverged, numbers.timeouts) == (3, 1, 1)
    assert numbers.collected == pytest.approx(100 / 3)
    assert numbers.sr <= 200 / 3
    quarantine = json.loads((root / "quarantine.json").read_text())
    assert [item["item"] for item in quarantine["items"]] == ["aliengo/path/mad"]


def test_a_diverged_episode_that_succeeds_later_leaves_no_dump(root: Path, tmp_path: Path) -> None:
    bundle_root = root / "scenes" / "two_rooms"
    dump = tmp_path / "mad.diverged.json"
    dump.write_text("{}")
    rollout = read_rollout(root / "rollouts" / "aliengo" / "path" / "good.mcap")
    walker = Walker(get_robot("aliengo"), ReplayConfig())
    ReplayJob(bundle_root, rollout.episode, walker, tmp_path, tmp_path / "mad.mcap").run()
    assert not dump.exists()
    assert (tmp_path / "mad.mcap").is_file()


def test_the_page_says_how_far_from_its_path_a_robot_was(root: Path) -> None:
    page = (root / "report" / "index.html").read_text()
    off = [float(text) for text in re.findall(r'data-label="Off path m">([\d.]+)<', page)]
    ids = re.findall(r'<tr id="([^"]+)"', page)
    assert ids == ["good@0", "slow@0"]
    for name, gap in zip(ids, off, strict=True):
        rollout = read_rollout(root / "rollouts" / "aliengo" / "path" / f"{name[:-2]}.mcap")
        path = resample(rollout.episode.reference_path_world_m[:, :2], 0.01)
        gaps = cdist(rollout.position_world_m[:, :2], path).min(axis=1)
        assert gap == pytest.approx(gaps.max(), abs=0.02)


def test_the_page_says_how_long_the_shortest_way_is_beside_the_walk(root: Path) -> None:
    page = (root / "report" / "index.html").read_text()
    cells = 'data-label="Shortest m">(.*?)</td><td data-label="TL m">(.*?)<'
    walks = root / "rollouts" / "aliengo" / "path"
    rollouts = [read_rollout(walks / f"{name}.mcap") for name in ("good", "slow")]
    expected = [(r.episode.geodesic_distance_m, r.metrics.trajectory_length_m) for r in rollouts]
    assert re.findall(cells, page) == [(f"{path:.1f}", f"{tl:.1f}") for path, tl in expected]
    assert "Shortest: the geodesic length" in page


def test_the_page_links_the_episodes_in_which_an_obstacle_was_touched(
    root: Path, tmp_path: Path
) -> None:
    copy = shutil.copytree(root, tmp_path / "run")
    assert "touched an obstacle in" not in (copy / "report" / "index.html").read_text()
    ledger = Ledger(copy)
    row = ledger.row("replay", "aliengo/path/slow")
    assert row is not None
    ledger.add(replace(row, facts={**row.facts, "contacts": 2}))
    ledger.save()
    assert main(["report", str(copy)]) == 0
    page = (copy / "report" / "index.html").read_text()
    (link,) = re.findall(r"aliengo/path touched an obstacle in (<a .*?</a>)\.", page)
    assert link == '<a href="#slow%400">slow</a>'
    assert page.count('<tr id="slow@0"') == 1


def test_the_page_shows_every_failure_and_a_clip_of_its_end(root: Path) -> None:
    page = (root / "report" / "index.html").read_text()
    assert "took too long" in page
    assert "diverged" in page
    (clip,) = re.findall(r'src="data:video/mp4;base64,([^"]+)"', page)
    images = []
    with av.open(io.BytesIO(base64.b64decode(clip)), mode="r") as container:
        images = [f.to_ndarray(format="rgb24") for f in container.decode(video=0)]
        stream = container.streams.video[0]
        assert stream.codec_context.pix_fmt == "yuv420p"  # browsers play no other
    slow = read_rollout(root / "rollouts" / "aliengo" / "path" / "slow.mcap")
    assert slow.end_reason == "timeout"
    seconds = min(slow.time_s[-1], 5.0)
    assert len(images) == pytest.approx(10 * seconds, abs=1.5)
    assert np.std(images[-1]) > 10  # not a blank picture
    links = re.findall(r"""(?:src|href|poster)=["']([^"'#]{0,40})""", page)
    assert all(link.startswith("data:") for link in links if link)


def test_clips_beyond_the_budget_are_named_and_every_robot_gets_some(tmp_path: Path) -> None:
    clips, rows = {}, []
    for robot, count in (("a", 20), ("b", 2)):
        for k in range(count):
            name = f"{robot}/path/{k}"
            clips[name] = tmp_path / f"{robot}-{k}.mp4"
            clips[name].write_bytes(b"x" * 3000)
            clips[name].with_suffix(".jpg").write_bytes(b"y" * 300)
            facts = {"robot": robot, "controller": "path", "episode": str(k), "end_reason": "fall"}
            facts |= {"detail": "roll 20°"}
            metrics = {"duration_s": 3.0, "navigation_error_euclidean_m": 1.0}
            rows.append(Row("replay", name, "k", "done", True, facts={**facts, "metrics": metrics}))
    figures = failure_figures(rows, [], clips, 6 * 4400)
    clips = [f["who"] for f in figures if f.get("video")]
    assert sorted(clips) == ["a, path"] * 4 + ["b, path"] * 2
    assert all(f["file"].startswith("clips/") for f in figures)
    embedded = sum(len(f.get("video", "")) + len(f.get("poster", "")) for f in figures)
    assert embedded <= 6 * 4400 + 6 * 60


@pytest.fixture(scope="module")
def frames(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("frames") / "frames"
    small = ("--width-px", 64, "--height-px", 48, "--workers", 1)
    assert vlnpe("render", root, "--scenes", root / "scenes", "--out", out, *small) == 0
    return out


def test_one_episode_is_filmed_by_its_name_in_the_scenes_of_its_run(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    items = [row.item for row in Ledger(root).rows("replay") if row.status == "done"]
    *_, episode = items[0].split("/", 2)
    chosen = sum(item.endswith(f"/{episode}") for item in items)
    assert chosen < len(items)
    small = ("--width-px", 64, "--height-px", 48, "--workers", 1, "--video")
    assert vlnpe("render", root, "--episode", episode, "--out", tmp_path / "films", *small) == 0
    assert len(list((tmp_path / "films").rglob("*.mp4"))) == chosen
    capsys.readouterr()
    assert vlnpe("render", root, "--episode", episode + "x", "--out", tmp_path / "no") == 2
    assert f"(did you mean {episode}?)" in capsys.readouterr().err
    (bare := tmp_path / "bare").mkdir()
    (bare / "manifest.json").write_bytes((root / "manifest.json").read_bytes())
    assert vlnpe("render", bare, "--out", tmp_path / "no") == 2
    assert "contains no scenes/; give it with --scenes FOLDER" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


def vlnpe(*arguments: object) -> int:
    return main([*map(str, arguments), "--json"])


def test_failures_are_exported_with_their_reason_unless_only_success(
    root: Path,
    frames: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    def export(*options: str) -> dict[str, dict[str, int]]:
        scenes = root / "scenes"
        assert vlnpe("export", frames, "--scenes", scenes, "--out", tmp_path, *options) == 0
        return json.loads(capsys.readouterr().out.splitlines()[-1])["stages"]

    def loaded() -> list[tuple[str, str]]:
        data: Any = LeRobotDataset("vlnpe/test", root=tmp_path / "lerobot" / DATASET)
        assert len(data) == sum(data.meta.episodes["length"])
        ids = data.meta.episodes["episode_id"]
        return list(zip(ids, data.meta.episodes["end_reason"], strict=True))

    def files() -> list[str]:
        return sorted(p.name for p in (tmp_path / "mcap" / DATASET).iterdir())

    export()
    assert loaded() == [("good", "success"), ("slow", "timeout")]
    assert files() == ["good.mcap", "slow.mcap"]
    assert read_rollout(tmp_path / "mcap" / DATASET / "slow.mcap").end_reason == "timeout"

    redone = export("--only-success")
    assert loaded() == [("good", "success")]
    assert files() == ["good.mcap"]
    assert {name: stage["done"] for name, stage in redone.items()} == {
        "export": 0,
        "mcap": 0,
        "dataset": 1,
    }

    again = export()
    assert loaded() == [("good", "success"), ("slow", "timeout")]
    assert files() == ["good.mcap", "slow.mcap"]
    assert again["export"]["done"] == 0
    assert again["mcap"]["done"] == 1
