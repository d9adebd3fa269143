"""What jobs leave in memory is what the files hold."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from vlnpe.formats.core.camera import DepthRange
from vlnpe.formats.video.mp4 import iterate_depth_codes, write_depth_video
from vlnpe.pipeline.jobs import handover
from vlnpe.pipeline.jobs.handover import DepthKeeper


def write(video: Path, keeper: DepthKeeper, seed: int, frames: int = 5) -> None:
    depth = np.random.default_rng(seed).uniform(0.0, 12.0, (frames, 32, 48)).astype(np.float32)
    keeper.begin()
    write_depth_video(video, depth, 4, DepthRange(), on_codes=keeper.add)
    keeper.end(video)


def test_kept_depth_is_what_decoding_gives(tmp_path):
    keeper, video = DepthKeeper(), tmp_path / "depth.mp4"
    write(video, keeper, seed=1)
    os.link(video, tmp_path / "linked.mp4")  # as the export does
    folder = tmp_path / "moved"
    folder.mkdir()
    video = video.rename(folder / "depth.mp4")  # as an atomic folder is
    kept = keeper.of(video)
    assert kept is not None
    assert np.array_equal(np.stack(kept), np.stack(list(iterate_depth_codes(video))))


def test_depth_of_a_replaced_video_is_not_used(tmp_path):
    keeper, video = DepthKeeper(), tmp_path / "depth.mp4"
    assert keeper.of(video) is None
    write(video, keeper, seed=1)
    write_depth_video(video, np.ones((5, 32, 48), np.float32), 4, DepthRange())
    assert keeper.of(video) is None
    keeper.begin()
    assert keeper.of(video) is None


def test_long_episodes_are_not_kept(tmp_path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(handover, "MOST_BYTES", 4 * 32 * 48 * 2)
    keeper, video = DepthKeeper(), tmp_path / "depth.mp4"
    write(video, keeper, seed=1, frames=5)
    assert keeper.of(video) is None
    write(video, keeper, seed=2, frames=4)
    assert keeper.of(video) is not None


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
