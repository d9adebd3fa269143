"""How many paths of which split each scene is asked for."""

from collections import Counter

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from vlnpe.formats.core.errors import InputError
from vlnpe.trajectory_sampler.presets import (
    PRESETS,
    choose_seen,
    get_preset,
    is_seen,
    parse_splits,
    plan_quotas,
)

TEN = [f"home-{k}" for k in range(10)]


def totals(plan):
    return dict(sum((Counter(quota) for quota in plan.values()), Counter()))


def test_the_published_sizes_over_ten_scenes():
    preset = get_preset("gru_vln10")
    published = {"train": 441, "val_seen": 111, "val_unseen": 1287}
    assert {s: n * preset.instructions for s, n in preset.splits.items()} == published
    seen = choose_seen(preset.splits, TEN, preset.seen)
    plan = plan_quotas(preset.splits, TEN, seen)
    assert totals(plan) == dict(preset.splits)
    assert len(seen) == 3
    for scene in TEN:
        assert sum(plan[scene].values()) in (61, 62)
        assert set(plan[scene]) == ({"train", "val_seen"} if scene in seen else {"val_unseen"})


def test_one_scene_for_the_lab():
    preset = PRESETS["lab_3dgs"]
    assert {s: n * preset.instructions for s, n in preset.splits.items()} == {
        "train": 160, "val_seen": 640,
    }  # fmt: skip
    seen = choose_seen(preset.splits, ["lab"], preset.seen)
    assert plan_quotas(preset.splits, ["lab"], seen) == {"lab": dict(preset.splits)}


def test_a_small_scene_may_get_fewer():
    splits = parse_splits("train=30, val_seen=10, val_unseen=20")
    plan = plan_quotas(splits, TEN[:4], TEN[:2], {"home-1": 8})
    assert sum(plan["home-1"].values()) == 8
    assert sum(plan["home-0"].values()) == 32
    assert totals(plan) == splits


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: parse_splits("train"), "train=147"),
        (lambda: parse_splits("train=0"), "train=0"),
        (lambda: parse_splits("train=1,train=2"), "train=2"),
        (lambda: get_preset("gru"), "gru_vln10"),
        (lambda: choose_seen({"train": 1, "val_unseen": 1}, ["a"]), "val_unseen needs a scene"),
        (lambda: choose_seen({"train": 1}, ["a"], named=["b"]), "'b'"),
        (lambda: plan_quotas({"train": 5}, ["a"], ["a"], {"a": 3}), "ask for 5"),
        (lambda: plan_quotas({"train": 5}, ["a"], ["a"], {"b": 3}), "'b'"),
    ],
)
def test_impossible_plans_say_why(call, words):
    with pytest.raises(InputError, match=words):
        call()


# A busy machine is no failure.
@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.dictionaries(st.sampled_from(["train", "val_seen", "val_unseen"]), st.integers(1, 500)),
    st.integers(2, 12),
)
def test_every_path_has_exactly_one_scene(splits, count):
    scenes = [f"s{k}" for k in range(count)]
    seen = choose_seen(splits, scenes)
    plan = plan_quotas(splits, scenes, seen)
    assert totals(plan) == splits
    for scene, quota in plan.items():
        assert all(is_seen(split) == (scene in seen) for split in quota)
        assert all(n > 0 for n in quota.values())
