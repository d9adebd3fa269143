"""A robot that joins a run later walks the paths that are there, if it has room on them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.runs.work import InlineWorkers
from vlnpe.formats.vlnce.files import read_episodes
from vlnpe.pipeline.engine.ledger import Ledger
from vlnpe.pipeline.execution.runner import Context, run_stage
from vlnpe.pipeline.stages.episodes import sample_items
from vlnpe.pipeline.stages.scenes import items as scene_items
from vlnpe.trajectory_sampler.config import SampleConfig
from vlnpe.trajectory_sampler.record import clearance_at

CONFIG = SampleConfig(count=3, min_length_m=4.0, min_gap_m=0.8, relax=False)


def sampled(root: Path, scene, radius_m: float, count: int = 3):
    """Sample for a robot as a run of the folder `root` does; return summary and paths."""
    scenes = scene_items.rows_of(scene.root.parent)
    out = root / "sampled.json.gz"
    context = Context(Ledger(root), InlineWorkers(1), progress=False)

    def item(name, own_m):
        config = replace(CONFIG, count=count, robot_radius_m=own_m)
        return sample_items.sample_item(scenes[name], scene.root.parent, out, config, 0)

    items = sample_items.items(context.ledger, [scene.root.name], radius_m, item)
    summary = run_stage(context, sample_items.STAGE, items)
    context.ledger.save()
    return summary, read_episodes(out)


def test_paths_with_room_for_a_wider_robot_stay(two_rooms, tmp_path, caplog):
    _, before = sampled(tmp_path, two_rooms, 0.3)
    summary, after = sampled(tmp_path, two_rooms, 0.38)
    assert (summary.done, summary.reused) == (0, 1)
    assert not caplog.records
    freemap = two_rooms.freemap(0)
    for old, new in zip(before, after, strict=True):
        np.testing.assert_array_equal(old.reference_path_world_m, new.reference_path_world_m)
        assert clearance_at(freemap, new.reference_path_world_m).min() >= 0.38


def test_paths_without_room_for_it_are_sampled_again_and_this_is_said(
    two_rooms, tmp_path, caplog: pytest.LogCaptureFixture
):
    sampled(tmp_path, two_rooms, 0.3)
    summary, after = sampled(tmp_path, two_rooms, 0.42)
    assert summary.done == 1
    assert "needs 0.42 m of clearance, but the existing episodes have 0.38 m" in caplog.text
    least = min(clearance_at(two_rooms.freemap(0), e.reference_path_world_m).min() for e in after)
    assert least >= 0.42


def test_other_options_are_no_reason_to_warn(two_rooms, tmp_path, caplog):
    sampled(tmp_path, two_rooms, 0.3)
    summary, _ = sampled(tmp_path, two_rooms, 0.42, count=2)
    assert summary.done == 1
    assert not caplog.records


def test_fewer_paths_than_before_are_said(two_rooms, tmp_path, caplog):
    (more, _), (fewer, _) = (sampled(tmp_path, two_rooms, 0.3, count=n) for n in (3, 2))
    sample_items.warn_if_fewer(fewer.rows, more.rows)
    assert not caplog.records
    sample_items.warn_if_fewer(more.rows, fewer.rows)
    assert "now hold 2 of the 3 paths that they held in two_rooms" in caplog.text
