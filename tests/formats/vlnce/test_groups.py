"""Episodes of one path are walked as one and come back as they were."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.rollouts import make_episode
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.vlnce.files import read_episodes, write_episodes
from vlnpe.formats.vlnce.groups import (
    group_by_path,
    instruction_count,
    instruction_ids,
    per_instruction,
    ungroup,
)


def episode(name: str, path: int, text: str, **changes) -> Episode:
    points = np.array([[0.0, path, 0.0], [4.0, path, 0.0]])
    extra = {"alignment": {"nudges": []}, "source_instruction": {"id": name}}
    places = {"start_position_world_m": points[0], "goal_position_world_m": points[-1]}
    ids = {"episode_id": name, "trajectory_id": str(path), "extra": extra}
    base = replace(make_episode(0, text), reference_path_world_m=points, **places, **ids)
    return replace(base, **changes)


EXTRAS = st.dictionaries(st.sampled_from("xyz"), st.integers(0, 2))
_R2R = (("1", 7, "Go."), ("4", 8, "Walk."), ("2", 7, "Leave."), ("3", 7, "Leave."))
R2R = [episode(*facts) for facts in _R2R]


def test_a_path_is_one_record_with_all_its_texts(tmp_path):
    groups = group_by_path(R2R)
    assert [g.episode_id for g in groups] == ["1", "4"]
    assert groups[0].instruction == "Go."
    assert groups[0].extra["instructions"] == ["Go.", "Leave.", "Leave."]
    assert instruction_ids(groups[0]) == ["1", "2", "3"]
    assert instruction_count(groups) == 4
    # Through the file that the robots' stages read.
    write_episodes(tmp_path / "paths.json.gz", groups)
    back = [e for g in read_episodes(tmp_path / "paths.json.gz") for e in ungroup(g)]
    assert [str(e) for e in back] == [str(R2R[k]) for k in (0, 2, 3, 1)]


def test_grouping_twice_changes_nothing():
    groups = group_by_path(R2R)
    assert [str(g) for g in group_by_path(groups)] == [str(g) for g in groups]


@pytest.mark.parametrize(
    "changes",
    [
        {"start_yaw_rad": 0.6},
        {"split": "val_seen"},
        {"scene_id": "other"},
        {"reference_path_world_m": np.array([[0.0, 7.0, 0.0], [2.0, 7.5, 0.0], [4.0, 7.0, 0.0]])},
    ],
)
def test_another_walk_is_another_path(changes):
    assert len(group_by_path([R2R[0], replace(R2R[2], **changes)])) == 2


def test_one_episode_per_instruction_for_tools_that_need_it():
    texts = [{"text": t, "style": s} for t, s in (("Go.", "terse"), ("Leave.", "rich"))]
    extra = {"instructions": ["Go.", "Leave."], "instruction": {"style": "terse", "texts": texts}}
    sampled = episode("home-0", 7, "Go.", extra=extra)
    separate = per_instruction(sampled)
    assert [e.episode_id for e in separate] == ["home-0", "home-0-2"]
    assert [e.instruction for e in separate] == ["Go.", "Leave."]
    assert separate[1].extra["instructions"] == ["Leave."]
    assert separate[1].extra["instruction"]["texts"] == [texts[1]]
    # And they are one path again.
    (again,) = group_by_path(separate)
    assert again.extra["instructions"] == ["Go.", "Leave."]
    assert [e.episode_id for g in group_by_path(R2R) for e in per_instruction(g)] == [
        "1", "2", "3", "4",
    ]  # fmt: skip


@settings(max_examples=80, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 3), st.text("ab", max_size=2), EXTRAS), max_size=8))
def test_every_original_comes_back(facts):
    originals = [episode(str(k), path, text, extra=x) for k, (path, text, x) in enumerate(facts)]
    back = {e.episode_id: e for g in group_by_path(originals) for e in ungroup(g)}
    assert len(back) == len(originals)
    for original in originals:
        again = back[original.episode_id]
        assert (again.instruction, again.extra) == (original.instruction, original.extra)
