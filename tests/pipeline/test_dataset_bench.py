"""`make dataset-bench`: what it asks `collect` for."""

from __future__ import annotations

from benchmarks import dataset
from vlnpe.pipeline.inputs.builtin import parse_builtin
from vlnpe.trajectory_sampler.presets import choose_seen, parse_splits, plan_quotas


def quotas(train: int, unseen: int, paths: int) -> dict[str, dict[str, int]]:
    names = [b.name for b in parse_builtin(dataset.scenes(train, unseen), 0)]
    splits = parse_splits(dataset.splits(train, unseen, paths))
    return plan_quotas(splits, names, choose_seen(splits, names, train))


def test_every_kind_is_trained_in_and_unseen_and_no_building_is_both() -> None:
    buildings = parse_builtin(dataset.scenes(40, 10), 0)
    assert len(buildings) == 50
    assert not any(building.scanned for building in buildings)
    for group in (buildings[:40], buildings[40:]):
        assert {b.kind for b in group} == set(dataset.KINDS)
    assert len({(b.kind, b.seed) for b in buildings}) == 50


def test_growing_the_set_keeps_the_shares_of_the_scenes_it_had() -> None:
    small, large = quotas(4, 2, 36), quotas(40, 10, 36)
    assert small.items() <= large.items()
    assert {sum(quota.values()) for quota in large.values()} == {36}
    assert large["exact-apartment-0"] == {"train": 32, "val_seen": 4}
    assert large["exact-apartment-1000"] == {"val_unseen": 36}


def test_robots_with_and_without_a_body_get_controllers_that_can_drive_them(monkeypatch) -> None:
    calls = []
    monkeypatch.setattr(dataset, "vlnpe", lambda arguments: calls.append(arguments) or 0)
    assert dataset.main(["--robot", "vlnce,h1", "--train", "2", "--unseen", "1", "--seed=3"]) == 0
    assert [call[-2:] for call in calls] == [
        ["--robot=h1", "--controller=speed"],
        ["--robot=vlnce", "--controller=flash"],
    ]
    assert all("--seed=3" in call for call in calls)
