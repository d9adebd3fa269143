"""What jobs leave in memory is what the files hold."""

import os
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.records import Schema

from tests.support.rollouts import make_rollout
from tests.support.scenes.storeys import LINE, TOP_M, write_two_storeys
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.camera import CameraModel, DepthRange
from vlnpe.formats.mcap.camera_streams import message_class
from vlnpe.formats.video.mp4 import iterate_depth_codes, write_depth_video
from vlnpe.pipeline.collect.together import sharing
from vlnpe.pipeline.engine.work import WorkItem
from vlnpe.pipeline.stages.datasets.mcap_job import McapJob, maps_on_the_way
from vlnpe.pipeline.stages.rollouts import handover
from vlnpe.pipeline.stages.rollouts.handover import DepthKeeper
from vlnpe.pipeline.stages.rollouts.render_job import RenderJob
from vlnpe.rendering.camera.extras import Extras
from vlnpe.rendering.camera.views import View


def kept_while_writing(video: Path, seed: int, frames: int = 5) -> DepthKeeper:
    depth = np.random.default_rng(seed).uniform(0.0, 12.0, (frames, 32, 48)).astype(np.float32)
    keeper = DepthKeeper()
    write_depth_video(video, depth, 4, DepthRange(), on_codes=keeper.add)
    keeper.end(video)
    return keeper


def test_kept_depth_is_what_decoding_gives(tmp_path):
    video = tmp_path / "depth.mp4"
    keeper = kept_while_writing(video, seed=1)
    os.link(video, tmp_path / "linked.mp4")  # as the export does
    folder = tmp_path / "moved"
    folder.mkdir()
    video = video.rename(folder / "depth.mp4")  # as an atomic folder is
    kept = keeper.of(video)
    assert kept is not None
    assert np.array_equal(np.stack(kept), np.stack(list(iterate_depth_codes(video, DepthRange()))))


def test_depth_of_a_replaced_video_is_not_used(tmp_path):
    video = tmp_path / "depth.mp4"
    assert DepthKeeper().of(video) is None
    keeper = kept_while_writing(video, seed=1)
    write_depth_video(video, np.ones((5, 32, 48), np.float32), 4, DepthRange())
    assert keeper.of(video) is None


def test_a_render_job_leaves_its_depth_to_the_mcap_job_of_its_chain(tmp_path):
    path, keeper = tmp_path / "x", DepthKeeper()
    view = View("ego", CameraModel("ego", 8, 8, 90.0))
    robot = get_robot("aliengo")
    render = RenderJob(path, path, "x", robot, view, 4, "h264", Extras(), "video", path)
    mcap = McapJob(path, path, path, robot, "x", (), "video", path, "", path)
    items = [WorkItem("x", "x", (path,), job) for job in (render, mcap)]
    jobs: list[Any] = [sharing(item, keeper).job for item in items]
    first, second = pickle.loads(pickle.dumps(jobs))  # as on the way to a worker
    assert first.depth is second.depth and first.depth is not keeper
    assert render.depth is not mcap.depth


def test_long_episodes_are_not_kept(tmp_path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(handover, "MOST_BYTES", 4 * 32 * 48 * 2)
    video = tmp_path / "depth.mp4"
    assert kept_while_writing(video, seed=1, frames=5).of(video) is None
    assert kept_while_writing(video, seed=2, frames=4).of(video) is not None


def test_a_replaced_rollout_is_read_again(tmp_path, monkeypatch: pytest.MonkeyPatch):
    path, read = tmp_path / "r.mcap", []

    def fake(path: Path) -> str:
        read.append(path.read_text())
        return read[-1]

    monkeypatch.setattr(handover, "read_rollout", fake)
    path.write_text("one")
    assert [handover.rollout_at(path) for _ in range(2)] == ["one", "one"]
    (tmp_path / "new").write_text("two")
    (tmp_path / "new").replace(path)
    assert handover.rollout_at(path) == "two" and read == ["one", "two"]


@pytest.mark.parametrize("climbs", [True, False])
def test_the_map_is_that_of_the_level_on_which_the_robot_is(tmp_path: Path, climbs: bool) -> None:
    bundle, walk = write_two_storeys(tmp_path), make_rollout(4.0)
    way = LINE if climbs else LINE * (1.0, 1.0, 0.0)
    over = {"staircases": [1], "levels": [0, 1]} if climbs else {}
    episode = replace(
        walk.episode,
        level=0,
        start_position_world_m=way[0],
        goal_position_world_m=way[-1],
        extra=over,
    )
    height_m = np.interp(walk.time_s, np.linspace(0.0, 4.0, len(way)), way[:, 2])
    track = np.column_stack([np.zeros((len(height_m), 2)), height_m + 0.4])
    walk = replace(walk, episode=episode, position_world_m=track)
    shown = maps_on_the_way(bundle, walk)
    kind: Any = message_class(Schema(1, shown.schema_data, "protobuf", shown.schema_name))
    maps = [(at / 1e9, kind.FromString(data).pose.position.z) for at, data in shown.messages]
    expected = [(0.0, 0.0), (2.0, TOP_M)][: 1 + climbs]
    assert np.array(maps) == pytest.approx(np.array(expected), abs=0.03)
