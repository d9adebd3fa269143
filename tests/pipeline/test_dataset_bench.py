"""`make dataset-bench`: what it asks `collect` for."""

import pytest

from benchmarks import dataset
from vlnpe.pipeline.inputs.builtin import parse_builtin
from vlnpe.trajectory_sampler.presets import choose_seen, parse_splits, plan_quotas


def quotas(train: int, paths: int) -> dict[str, dict[str, int]]:
    names = [b.name for b in parse_builtin(dataset.scenes(0, train, dataset.KINDS), 0)]
    splits = parse_splits(dataset.splits(train, paths))
    return plan_quotas(splits, names, choose_seen(splits, names, train))


def test_every_kind_is_trained_in_and_unseen_and_no_building_is_both() -> None:
    groups = [
        parse_builtin(dataset.scenes(first, count, dataset.KINDS), 0)
        for first, count in ((0, 40), (dataset.FIRST_UNSEEN_SEED, 10))
    ]
    assert [len(group) for group in groups] == [40, 10]
    for group in groups:
        assert {b.kind for b in group} == set(dataset.KINDS)
    buildings = [b for group in groups for b in group]
    assert not any(building.scanned for building in buildings)
    assert len({(b.kind, b.seed) for b in buildings}) == 50


def test_growing_the_set_keeps_the_shares_of_the_scenes_it_had() -> None:
    small, large = quotas(4, 36), quotas(40, 36)
    assert small.items() <= large.items()
    assert {sum(quota.values()) for quota in large.values()} == {36}
    assert large["exact-apartment-0"] == {"train": 32, "val_seen": 4}


def test_kinds_are_chosen_and_checked(capsys: pytest.CaptureFixture[str]) -> None:
    assert {b.kind for b in parse_builtin(dataset.scenes(7, 5, ["villa"]), 0)} == {"villa"}
    with pytest.raises(SystemExit):
        dataset.main(["--kinds", "villa,tent,hose"])
    said = "--kinds: hose (did you mean house?), tent; valid: apartment, villa, house"
    assert said in capsys.readouterr().err


def test_robots_with_and_without_a_body_get_controllers_that_can_drive_them(monkeypatch) -> None:
    calls = []
    monkeypatch.setattr(dataset, "vlnpe", lambda arguments: calls.append(arguments) or 0)
    assert dataset.main(["--robot", "vlnce,h1", "--train", "2", "--unseen", "1", "--seed=3"]) == 0
    unseen, *trainings = calls
    assert [call[-2:] for call in trainings] == [
        ["--robot=h1", "--controller=speed"],
        ["--robot=vlnce", "--controller=flash"],
    ]
    assert "--splits=val_unseen=24" in unseen and "--only-episodes" in unseen
    assert all("--seed=3" in call for call in calls)


def test_scanned_buildings_are_those_of_the_exact_set(monkeypatch) -> None:
    calls: list[list[str]] = []
    monkeypatch.setattr(dataset, "vlnpe", lambda arguments: calls.append(arguments) or 0)
    for more in ([], ["--scanned"]):
        assert dataset.main(["--robot", "vlnce", "--train", "3", "--unseen", "2", *more]) == 0
    scenes = [
        parse_builtin(option.removeprefix("--scene="), 0)
        for call in calls
        for option in call
        if option.startswith("--scene=")
    ]
    assert [{b.scanned for b in group} for group in scenes] == [{False}, {False}, {True}, {True}]
    named = [[(b.kind, b.seed) for b in group] for group in scenes]
    assert named[:2] == named[2:]
