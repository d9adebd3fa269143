"""`vlnpe adapt`: goals that are set aside, buildings too small, and the chain at a tiny size."""

import json
from collections import Counter
from pathlib import Path

import pytest

from tests.collectors.test_replay import make_episode
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.errors import SceneError
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.vlnce.files import read_episodes
from vlnpe.learning.card import read_card
from vlnpe.learning.training.holdout import rooms_aside
from vlnpe.pipeline.cli import main
from vlnpe.pipeline.commands.training import adapt
from vlnpe.pipeline.commands.training.adapt import goal_rooms, split_by_room
from vlnpe.pipeline.commands.training.adapt_page import answer, doubts


@pytest.mark.parametrize("paths", [{"a": 5, "b": 5, "c": 5}, dict.fromkeys("abcdefgh", 4)])
def test_about_a_third_of_the_goals_is_set_aside(paths: dict[str, int]) -> None:
    drawn = {rooms_aside(paths, seed) for seed in range(20)}
    for rooms in drawn:
        assert 1 / 3 <= sum(paths[room] for room in rooms) / sum(paths.values()) <= 1 / 2
    assert len(drawn) > 1  # by the seed
    assert rooms_aside(dict(reversed(paths.items())), 0) == rooms_aside(paths, 0)


def test_a_room_with_most_of_the_goals_is_trained_on() -> None:
    for seed in range(10):
        assert "hall" not in rooms_aside({"hall": 20, "bath": 6, "bed": 7}, seed)
    assert rooms_aside({"hall": 8}, 0) == ()


def paths_of(scene: SceneBundle, count: int) -> list[Episode]:
    """Return paths that end in the one and in the other room, in turn."""
    goals = ((0.9, 2.3), (6.0, 2.0))
    return [
        make_episode(scene, goals[k % 2], goals[1 - k % 2], name=f"path-{k}") for k in range(count)
    ]


def test_paths_are_divided_by_the_room_of_their_goal(
    two_rooms: SceneBundle, monkeypatch: pytest.MonkeyPatch
) -> None:
    episodes = paths_of(two_rooms, 24)
    rooms = goal_rooms(two_rooms, episodes)
    assert Counter(rooms).most_common()[0][1] == 12 and len(set(rooms)) == 2
    with pytest.raises(SceneError, match="rooms in which its 24 paths end: 2; "):
        split_by_room(two_rooms, episodes, 0)
    monkeypatch.setattr(adapt, "LEAST_ROOMS", 2)
    parts = split_by_room(two_rooms, episodes, 0)
    held, trained = (set(goal_rooms(two_rooms, some)) for some in (parts.held, parts.train))
    assert held == set(parts.rooms) and trained == set(parts.others) and not held & trained
    assert {e.split for e in parts.held} == {"val_seen"} and len(parts.train) == 12
    assert sorted(e.episode_id for e in (*parts.held, *parts.train)) == sorted(
        e.episode_id for e in episodes
    )
    with pytest.raises(SceneError, match="set aside by room: 5;"):
        split_by_room(two_rooms, episodes[:10], 0)


def test_the_answer_says_no_more_than_its_interval() -> None:
    def sr(mean: float, low: float, high: float) -> dict[str, dict[str, float]]:
        return {"SR": {"mean": mean, "low": low, "high": high}}

    value = {
        "policy": "cma-robots-32px", "held": 20, "train": 40, "asked": 60, "arrived": 40,
        "unknown": 0.0, "failed": 0, "before": sr(10, 0, 25), "after": sr(40, 20, 60),
    }  # fmt: skip
    cases = {"a gain is shown": (30, 5, 55), "no gain is shown": (30, -1, 61)}
    cases["a loss is shown"] = (-30, -50, -10)
    for verdict, change in cases.items():
        assert answer(value | {"difference": sr(*change)}).endswith(verdict)
    sure = value | {"difference": sr(30, 25, 35)}
    assert doubts(sure) == []
    poor = sure | {"asked": 80, "arrived": 9, "unknown": 0.2, "difference": sr(30, 5, 55)}
    assert len(doubts(poor)) == 4 and "below about 25 points" in doubts(poor)[1]


@pytest.mark.parametrize("policy", ["random", "nowhere.safetensors"])
def test_what_cannot_be_adapted_is_refused(
    policy: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = ["adapt", "builtin", "--policy", policy, "--out", str(tmp_path / "out")]
    assert main(call) == 2
    assert "--policy random: valid" in (error := capsys.readouterr().err) or "no such file" in error
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.chain
def test_from_a_building_to_a_checkpoint_and_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    call = ["adapt", "builtin-exact:apartment", "--robot", "vlnce", "--paths", "24", "--steps", "4"]
    call += ["--threads", "1", "--workers", "1", "--out", str(out), "--json"]
    assert main(call) == 0
    value = json.loads(capsys.readouterr().out)
    checkpoint = Path(value["checkpoint"])
    card, _ = read_card(checkpoint)
    held = read_episodes(out / "paths" / "val_seen.json.gz")
    trained = read_episodes(out / "paths" / "train.json.gz")
    assert len(held) >= 6 and len(held) + len(trained) == 24
    names = {f"{e.scene_id}/{e.trajectory_id}" for e in held}
    assert set(card.held_out["trajectories"]) == names and card.start
    assert card.data[0]["episodes"] <= len(trained) and card.steps == 4
    for place in ("before", "after"):
        results = json.loads((out / place / "results.json").read_text())
        walked = {f"{e['scene']}/{e['trajectory']}" for e in results["episodes"]}
        assert walked == names
    page = (out / "report.html").read_text()
    assert "<video" in page and "before" in page and "vlnpe serve" in page
    times = {p: p.stat().st_mtime_ns for p in (*out.rglob("*.mcap"), *out.rglob("cma.safetensors"))}
    assert main(call) == 0
    assert json.loads(capsys.readouterr().out) == value
    assert {p: p.stat().st_mtime_ns for p in times} == times
