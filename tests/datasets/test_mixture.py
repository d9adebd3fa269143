"""Mixtures: recipes, what they choose, and the order in which it is drawn."""

import json
import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.lerobot_data import write_foreign_dataset, write_unit
from tests.support.training_data import make_walk, write_dataset
from vlnpe.datasets.mixture.choice import Library, choose
from vlnpe.datasets.mixture.loader import MixtureLoader
from vlnpe.datasets.mixture.plan import plan_mixture
from vlnpe.datasets.mixture.recipe import Recipe, Source, read_recipe, recipe_of
from vlnpe.datasets.mixture.sampler import MixtureSampler
from vlnpe.datasets.mixture.shipped import SHIPPED, recipe_path
from vlnpe.datasets.sequences import EpisodeSequences, SequenceConfig, collate_sequences
from vlnpe.datasets.tokens import training_tokens
from vlnpe.formats.core.errors import FileFormatError, InputError
from vlnpe.formats.lerobot import assemble_dataset
from vlnpe.pipeline.cli import main
from vlnpe.pipeline.commands.training.missing import collect_command
from vlnpe.pipeline.engine.ledger import Ledger
from vlnpe.pipeline.engine.rows import Row

EPISODES = {"h1": 6, "aliengo": 8, "vlnce": 5}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs; of the humanoid's episodes one falls."""
    root = tmp_path_factory.mktemp("runs")
    for robot, count in EPISODES.items():
        lengths = [0.5 + 0.25 * (n % 3) for n in range(count)]
        write_dataset(root / f"run-{robot}", robot, lengths, falls=[1] if robot == "h1" else [])
    return root


def recipe(**changes: Any) -> dict[str, Any]:
    value: dict[str, Any] = {
        "recipe": 1,
        "title": "Test",
        "sources": {
            "humanoid": {"robots": ["h1"]},
            "quadruped": {"robots": "aliengo", "fraction": 0.5},
            "ghost": {"data": "run-vlnce/lerobot/*", "controllers": ["flash"]},
        },
        "mixtures": {
            "alone": ["humanoid"],
            "all": {"humanoid": 1.0, "quadruped": 2.0, "ghost": 1},
            "even": {"sources": ["humanoid", "ghost"], "shares": "equal"},
        },
    }
    return value | changes


SIZES = st.lists(st.integers(1, 40), min_size=1, max_size=4)


@settings(max_examples=40, deadline=None)
@given(SIZES, st.data(), st.integers(0, 5))
def test_every_item_comes_once_before_any_comes_again(sizes, data, seed) -> None:
    shares = data.draw(st.lists(st.floats(0.1, 3), min_size=len(sizes), max_size=len(sizes)))
    draws = MixtureSampler(sizes, shares, seed).draws(0, 400)
    for source, size in enumerate(sizes):
        items = [item for s, item in draws if s == source]
        for begin in range(0, len(items) - size + 1, size):
            assert sorted(items[begin : begin + size]) == list(range(size))
        expected = 400 * shares[source] / sum(shares)
        assert abs(len(items) - expected) < 6  # at once, not only on average


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 120), st.integers(1, 50), st.integers(1, 4))
def test_it_resumes_at_any_item_and_splits_among_processes(
    drawn: int, length: int, world: int
) -> None:
    def sampler(rank: int = 0, world: int = 1, length: int = length) -> MixtureSampler:
        return MixtureSampler([7, 3, 19], [1, 2, 3], 5, length, rank, world)

    whole = sampler().draws(0, 300)
    first = sampler()
    given_out = []
    while len(given_out) < drawn:
        for pair in first:
            given_out.append(pair)
            if len(given_out) == drawn:
                break
    second = sampler()
    second.load_state_dict(json.loads(json.dumps(first.state_dict())))
    rest = list(second)
    assert [*given_out, *rest] == whole[: drawn + len(rest)]
    assert (drawn + len(rest)) % length == 0
    ranks = [sampler(rank, world, 12) for rank in range(world)]
    assert ranks[0].draws(5, 7) == ranks[0].draws(0, 12)[5:]
    joined = [p for step in zip(*(r.draws(0, 60) for r in ranks), strict=True) for p in step]
    for source, size in enumerate([7, 3, 19]):  # all processes together give out every item once
        items = [item for s, item in joined if s == source]
        for begin in range(0, len(items) - size + 1, size):
            assert sorted(items[begin : begin + size]) == list(range(size))


@pytest.mark.parametrize("world", [1, 2, 3, 5, 8, 13, 64])
def test_shares_hold_for_each_process_and_for_all(world: int) -> None:
    shares = np.array([0.5, 0.3, 0.2])
    ranks = [MixtureSampler([90, 50, 70], shares, 4, None, r, world) for r in range(world)]
    chosen = np.array([[source for source, _ in rank.draws(0, 120)] for rank in ranks])
    counts = (chosen[..., None] == np.arange(3)).cumsum(1)  # (rank, draw, source)
    expected = np.arange(1, 121)[:, None] * shares
    assert abs(counts - expected).max() < 3
    assert abs(counts.sum(0) - world * expected).max() < 10
    runs = np.diff(np.flatnonzero(np.diff(chosen[0]) != 0))
    assert runs.max() <= 3  # no long run of draws from one source


def test_a_state_belongs_to_its_episodes(runs: Path) -> None:
    library = Library(runs)
    plan = plan_mixture(recipe_of(recipe()), "alone", library)
    others = recipe(sources=recipe()["sources"] | {"humanoid": {"robots": ["vlnce"]}})
    other = plan_mixture(recipe_of(others), "alone", library)
    assert plan.sizes == other.sizes
    first, second = (MixtureSampler(p.sizes, p.shares, content=p.digest) for p in (plan, other))
    with pytest.raises(InputError, match="content"):
        second.load_state_dict(first.state_dict())
    first.load_state_dict(json.loads(json.dumps(first.state_dict())))


def test_epochs_and_seeds_differ() -> None:
    sampler = MixtureSampler([50], [1])
    assert list(sampler) != list(sampler)
    assert MixtureSampler([50], [1], 1).draws(0, 50) != MixtureSampler([50], [1], 2).draws(0, 50)
    with pytest.raises(InputError, match="sizes"):
        MixtureSampler([50], [1]).load_state_dict(MixtureSampler([49], [1]).state_dict())
    with pytest.raises(InputError, match="all above 0"):
        MixtureSampler([50, 0], [1, 1])


def loader(runs: Path, workers: int = 0) -> MixtureLoader:
    plan = plan_mixture(recipe_of(recipe()), "all", Library(runs))
    tokens = training_tokens(["walk"], 4)
    sources = [
        EpisodeSequences(s.selection, tokens, SequenceConfig(size_px=8)) for s in plan.sources
    ]
    sampler = MixtureSampler(plan.sizes, plan.shares, seed=3, length=14)
    return MixtureLoader(sources, sampler, 4, workers, collate_sequences)


def test_batches_are_the_same_with_workers_and_after_going_on(runs: Path) -> None:
    alone = loader(runs)
    assert len(alone) == 4
    batches = [*alone, *alone]  # two epochs
    assert [len(b["uid"]) for b in batches] == [4, 4, 4, 2] * 2
    assert {r for b in batches for r in b["robot"]} == set(EPISODES)
    helped, state = loader(runs, workers=1), {}
    for number, batch in enumerate(helped):
        assert batch["uid"] == batches[number]["uid"]
        torch.testing.assert_close(batch["depth"], batches[number]["depth"])
        if number == 1:
            state = json.loads(json.dumps(helped.state_dict()))
            break
    resumed = loader(runs)
    resumed.load_state_dict(state)  # workers had fetched ahead; the state tells what was given
    assert len(resumed) == 2
    for number, batch in enumerate([*resumed, *resumed], 2):
        assert batch["uid"] == batches[number]["uid"]
        assert batch["source"] == batches[number]["source"]


def test_the_plan_counts_what_it_takes_and_why_not(runs: Path) -> None:
    made = recipe_of(recipe())
    plan = plan_mixture(made, "all", Library(runs))
    humanoid, quadruped, ghost = plan.sources
    assert len(humanoid.selection) == 5
    dropped = Counter()
    for row in humanoid.rows:
        dropped.update(row.dropped)
    assert dropped == {"robot aliengo": 8, "robot vlnce": 5, "end_reason fall": 1}
    assert 0 < len(quadruped.selection) < 8
    assert len(ghost.selection) == 5
    raw = [5 * 1.0, len(quadruped.selection) * 2.0, 5 * 1.0]
    assert plan.shares == pytest.approx([value / sum(raw) for value in raw])
    assert plan_mixture(made, "even", Library(runs)).shares == pytest.approx([0.5, 0.5])
    frames = plan_mixture(made, "alone", Library(runs), "frames")
    assert frames.sizes == [int(humanoid.selection.lengths.sum())]
    everything = set(humanoid.selection.trajectories())
    some = frozenset(list(everything)[:2])
    rest = plan_mixture(made, "alone", Library(runs), held_out=some).sources[0]
    assert set(rest.selection.trajectories()) == everything - some


def test_other_views_and_copies_are_left_out_and_counted(runs: Path, tmp_path: Path) -> None:
    for camera in ("ego", "chase"):
        write_dataset(tmp_path / "a", "h1", [0.5, 0.75, 0.5], camera=camera)
    shutil.copytree(tmp_path / "a" / "lerobot" / "h1", tmp_path / "b" / "lerobot" / "converted")
    library = Library(tmp_path)

    def taken(**changes: Any) -> tuple[list[str], Counter[str]]:
        selection, rows = choose(Source(robots=("h1",), **changes), "x", library)
        dropped: Counter[str] = Counter()
        for row in rows:
            dropped.update(row.dropped)
        entries = [selection.entry(n) for n in range(len(selection))]
        return sorted(f"{e.camera} {e.uid.split('/')[-1]}" for e in entries), dropped

    own = ["ego ep0", "ego ep1", "ego ep2"]
    assert taken() == (own, {"camera chase": 3, "duplicate": 3})
    every, dropped = taken(cameras=())
    assert every == [*(f"chase ep{n}" for n in range(3)), *own] and dropped == {"duplicate": 3}
    with pytest.raises(InputError, match="6 × camera ego"):
        taken(cameras=("top",))


def test_a_larger_fraction_contains_a_smaller_one_for_every_robot(runs: Path) -> None:
    library = Library(runs)
    taken = {
        (robot, part): set(
            choose(Source(robots=(robot,), fraction=part), "x", library)[0].trajectories()
        )
        for robot in ("aliengo", "vlnce")
        for part in (0.5, 0.8, 1.0)
    }
    for robot in ("aliengo", "vlnce"):
        assert taken[robot, 0.5] <= taken[robot, 0.8] <= taken[robot, 1.0]
    assert taken["vlnce", 0.5] <= taken["aliengo", 0.5]


TESTS = {"tests": {"h1": {"robot": "h1"}}}
CLAIM = {"text": "more helps", "more": "all", "less": "alone"}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"recipe": 2}, "valid: 1"),
        (
            {"surces": {}},
            "recipe: 'surces' (did you mean sources?); valid: comparison",
        ),
        (
            {"sources": {"humanoid": {"robot": "h1"}}},
            "'robot' (did you mean robots?)",
        ),
        ({"sources": {"humanoid": {"outcomes": ["won"]}}}, "'won'; valid: collision_start"),
        ({"sources": {"humanoid": {"fraction": 2}}}, "fraction 2"),
        ({"sources": {"humanoid": {"robots": [3]}}}, "a name, or a list of names"),
        (
            {"mixtures": {"all": ["humanoids"]}},
            "(did you mean humanoid?); valid: ghost",
        ),
        ({"mixtures": {"all": {"ghost": -1}}}, "weight -1"),
        ({"mixtures": {"all": {"ghost": "much"}}}, "'much'; valid: a number"),
        ({"mixtures": {"all": {"sources": ["ghost"], "shares": "fair"}}}, "'fair'; valid: equal"),
        ({"mixtures": {}}, "at least one mixture"),
        ({"comparison": {}}, "comparison: tests"),
        ({"comparison": {"tests": {"h1": {"robots": "h1"}}}}, "'robots' (did you mean robot?)"),
        ({"comparison": {**TESTS, "rows": {"a": {"mixture": "none"}}}}, "valid: all, alone, even"),
        ({"comparison": {**TESTS, "rows": {"a": {}}}}, "either a mixture or a policy"),
        ({"comparison": {**TESTS, "walks": 0}}, "walks 0; valid: 1 or more"),
        ({"comparison": {**TESTS, "claims": ["all"]}}, "a mapping of names to values"),
        (
            {"comparison": {**TESTS, "claims": [CLAIM | {"less": "none"}]}},
            "valid: all, alone, even",
        ),
        ({"comparison": {**TESTS, "claims": [CLAIM | {"less": "all → dog"}]}}, "'dog'; valid: h1"),
        ({"comparison": {**TESTS, "claims": [CLAIM | {"metric": "PL"}]}}, "'PL'"),
        ({"holdout": "room"}, "'room'; valid: auto, none, scene, split, trajectory"),
        ({"holdout_fraction": 1.0}, "between 0 and 1"),
    ],
)
def test_an_invalid_recipe_lists_what_is_valid(changes: dict, message: str, tmp_path: Path) -> None:
    path = tmp_path / "recipe.yaml"
    path.write_text(json.dumps(recipe(**changes)))
    with pytest.raises(FileFormatError) as caught:
        read_recipe(path)
    assert message in str(caught.value)
    assert "recipe.yaml" in str(caught.value)


@pytest.mark.parametrize("text", ["a: [", "- 1", "", "\x00"])
def test_files_that_are_no_recipes_are_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "recipe.yaml"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=r"recipe\.yaml"):
        read_recipe(path)


def test_shipped_recipes_are_valid() -> None:
    found = {name: read_recipe(recipe_path(name)) for name in SHIPPED}
    assert set(found) == {
        "starter",
        "cross_embodiment",
        "controller",
        "lighting",
        "quadruped_for_humanoid",
    }
    assert all(found[name].comparison for name in found if name != "starter")
    table: Recipe = found["cross_embodiment"]
    assert len(table.mixtures) >= 6


@pytest.mark.parametrize("command", ["mix", "train", "ablate"])
def test_help_lists_all_shipped_recipes_and_a_misspelt_one_suggests_the_closest(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([command, "--help"])
    shown = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert (
        "built-in recipe: controller, cross_embodiment, lighting, quadruped_for_humanoid, starter."
        in shown
    )
    with pytest.raises(InputError, match=r"recipe startr \(did you mean starter\?\): no such file"):
        recipe_path("startr")


def test_the_command_shows_what_it_trains_on(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "recipe.yaml"
    path.write_text(json.dumps(recipe()))
    assert main(["mix", str(path), "--data", str(runs), "--dry-run", "--json"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any("humanoid" in line and "1 end_reason fall" in line for line in lines)
    plan = json.loads(lines[-1])
    assert [m["mixture"] for m in plan["mixtures"]] == ["alone", "all", "even"]
    assert sum(s["share"] for s in plan["mixtures"][1]["sources"]) == pytest.approx(1)
    out = tmp_path / "chosen.json"
    assert main(["mix", str(path), "--data", str(runs), "--out", str(out)]) == 0
    chosen = json.loads(out.read_text())["episodes"]["alone"]["humanoid"]
    assert list(chosen.values()) == [[0, 2, 3, 4, 5]]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--dry-run", "--mixture", "some"], "valid: all, alone, even"),
        (["--dry-run", "--draws", "steps"], "valid: episodes, frames"),
        ([], "--dry-run"),
        (["--dry-run", "--data", "nowhere"], "no such folder"),
    ],
)
def test_wrong_calls_end_with_code_2(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list, message: str
) -> None:
    path = tmp_path / "recipe.yaml"
    path.write_text(json.dumps(recipe()))
    assert main(["mix", str(path), "--data", str(runs), *arguments]) == 2
    assert message in capsys.readouterr().err


def test_sources_without_episodes_are_named_with_the_commands_that_collect_them(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sources = {
        "humanoid": {"robots": ["g1"]},
        "lamp": {"robots": ["g1"], "lights": ["CL"]},
        "known": {"robots": ["h1"]},
        "wheeled": {"robots": ["jetbot"], "fraction": 0.5},
    }
    path = tmp_path / "recipe.yaml"
    path.write_text(json.dumps(recipe(sources=sources, mixtures={"a": [*sources], "b": ["lamp"]})))
    assert main(["mix", str(path), "--data", str(runs), "--dry-run"]) == 2
    reason, humanoid, lamp = capsys.readouterr().err.splitlines()[-3:]
    asked = (
        "robot g1 (source 'humanoid') and robot g1, light CL (source 'lamp') and robot jetbot "
        "(source 'wheeled')"
    )
    assert f"no episodes of {asked} (left out of 3 datasets in {runs}: " in reason
    assert "8 × robot aliengo, 6 × robot h1" in reason and "known" not in reason
    new_run = f"--episodes 24 --out {runs / 'apartment-0'}"
    assert humanoid.endswith(f"collect --robot g1,jetbot {new_run}  # humanoid, wheeled")
    assert lamp.endswith(f"collect --robot g1 --light CL {new_run}  # lamp")


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("vlnpe collect", "vlnpe collect --robot g1"),
        ("vlnpe collect --robot h1", "vlnpe collect --robot g1"),
        ("vlnpe collect --out 'a b' --robot h1", "vlnpe collect --out 'a b' --robot g1"),
    ],
)
def test_missing_robots_join_the_run_at_hand(before: str, after: str, tmp_path: Path) -> None:
    ledger = Ledger(tmp_path)
    ledger.finished = before
    ledger.save()
    assert collect_command(Source(robots=("g1",)), tmp_path) == after


def walked(root: Path, finished: str, scenes: dict[str, int]) -> Path:
    """Write the ledger of a run in which two robots walked paths, the second half as many."""
    root.mkdir()
    ledger = Ledger(root)
    ledger.finished = finished
    for scene, count in scenes.items():
        for robot, paths in (("h1", count), ("aliengo", count // 2)):
            for n in range(paths):
                item, facts = f"{robot}/path/{scene}-{n}", {"scene": scene}
                ledger.add(Row("replay", item, "k", "done", facts=facts))
    ledger.save()
    return root


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("collect", "collect --robot g1 --episodes 9"),
        ("collect --episodes 2 --out a", "collect --out a --robot g1 --episodes 9"),
        ("collect --episodes 12", "collect --episodes 12 --robot g1"),
        ("collect --episodes gru_vln10", "collect --episodes gru_vln10 --robot g1"),
        ("collect --splits train=9", "collect --splits train=9 --robot g1"),
    ],
)
def test_missing_robots_get_all_paths_that_others_walked(
    before: str, after: str, tmp_path: Path
) -> None:
    walked(tmp_path / "a-small", "vlnpe collect --episodes 3", {"flat": 3})
    walked(tmp_path / "b-large", f"vlnpe {before}", {"flat": 9, "villa": 8})
    assert collect_command(Source(robots=("g1",)), tmp_path) == f"vlnpe {after}"


def test_sources_of_different_paths_are_named(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "recipe.yaml"
    path.write_text(json.dumps(recipe()))
    call = ["mix", str(path), "--data", str(runs), "--dry-run", "--mixture"]
    assert main([*call, "even"]) == 0
    said = "the sources hold different paths: humanoid 5, ghost 5; 4 are in all of them"
    assert said in capsys.readouterr().out
    assert main([*call, "alone"]) == 0
    assert "different paths" not in capsys.readouterr().out


def test_published_splits_are_not_trained_on(tmp_path: Path) -> None:
    units = []
    (tmp_path / "units").mkdir()
    for number, split in enumerate(("train", "train", "val_seen", "val_unseen", "val")):
        walk = make_walk(number, "h1", 0.5)
        walk = replace(walk, episode=replace(walk.episode, split=split))
        units.append(write_unit(tmp_path / "units", walk, number, camera_name="ego"))
    out = tmp_path / "lerobot" / "h1"
    assemble_dataset(units, out, provenance={}, licence="mit", title="h1")
    assert json.loads((out / "meta/splits.json").read_text())["val_seen"] == [2]
    library, value = Library(tmp_path), recipe(sources={"all": {}}, mixtures={"m": ["all"]})
    (source,) = plan_mixture(recipe_of(value), "m", library).sources
    assert set(source.selection.labels("split")) == {"train", "val"}
    assert source.rows[0].dropped == {
        "published hold-out val_seen": 1, "published hold-out val_unseen": 1,
    }  # fmt: skip
    # A source that names a split gets it; what is not for training gets all.
    value["sources"] = {"all": {"splits": ["val_seen"]}}
    (source,) = plan_mixture(recipe_of(value), "m", library).sources
    assert list(source.selection.labels("split")) == ["val_seen"]
    assert len(choose(Source(), "all", library)[0]) == 5


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_a_dataset_of_others_does_not_stop_a_mixture(
    runs: Path, tmp_path: Path, version: str, caplog: pytest.LogCaptureFixture
) -> None:
    shutil.copytree(runs, tmp_path / "runs")
    foreign = write_foreign_dataset(tmp_path / "runs" / "unitree" / "lerobot" / "g1", version)
    if version == "v3.0":
        (foreign / "meta" / "episodes").mkdir()
        shutil.copy(
            foreign / "data/chunk-000/episode_000000.parquet",
            foreign / "meta/episodes/file-000.parquet",
        )
    library = Library(tmp_path / "runs")
    assert len(library.find(["**/lerobot/*"])) == 3
    assert caplog.text.count("left out") == 1 and str(foreign) in caplog.text
    with pytest.raises(FileFormatError, match="LeRobot v2.1" if version == "v2.1" else "collected"):
        library.find(["unitree/lerobot/*"])
    (foreign / "meta" / "info.json").write_text("{")
    with pytest.raises(FileFormatError, match="not JSON"):
        Library(tmp_path / "runs").find(["**/lerobot/*"])
