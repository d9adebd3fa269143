"""Bundles record the staircases between their levels, and the sheets of those one can climb."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.scenes.rooms import write_two_rooms
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.scene.bundle import SceneBundle, load_bundle, save_bundle
from vlnpe.formats.scene.staircase import Staircase, Treads

LINE = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [3.0, 0.0, 2.8], [3.5, 0.0, 2.8]])
TREADS = Treads(np.ones((2, 3)), np.full((2, 3), 0.1), np.array([0.0, 0.3]))


def with_stairs(root: Path) -> SceneBundle:
    """Write two levels, a staircase that nobody climbs, and one that has the sheet of a level."""
    bundle = write_two_rooms(root)
    bundle = replace(
        bundle,
        level_floor_z_m=(0.0, 2.8),
        staircases=(
            Staircase((0, 1), LINE, 0.5, 0.17, 0.26, "is 0.50 m wide"),
            Staircase((0, 1), LINE, 0.9, 0.17, 0.26),
        ),
    )
    sheet = bundle.floor(0), bundle.obstacles(0), bundle.freemap(0)
    save_bundle(bundle, bundle.visual(), [sheet, sheet], {1: (*sheet, TREADS)})
    return bundle


def test_staircases_are_read_as_they_were_written(tmp_path: Path) -> None:
    written, bundle = with_stairs(tmp_path), load_bundle(tmp_path)
    for one, other in zip(written.staircases, bundle.staircases, strict=True):
        assert np.array_equal(one.line_world_m, other.line_world_m)
        assert one.as_json() == other.as_json()
    assert np.array_equal(bundle.stair_floor(1).height_m, bundle.floor(0).height_m)
    assert np.array_equal(bundle.stair_obstacles(1).half_m, bundle.obstacles(0).half_m)
    assert np.array_equal(bundle.stair_freemap(1).traversable, bundle.freemap(0).traversable)
    assert np.array_equal(bundle.stair_treads(1).yaw_rad, TREADS.yaw_rad)
    assert bundle.stair_treads(1).top_m == pytest.approx([1.1, 1.1])


def test_what_nobody_climbs_has_no_sheet_and_says_why(tmp_path: Path) -> None:
    with_stairs(tmp_path)
    bundle = load_bundle(tmp_path)
    with pytest.raises(ValueError, match=r"staircase 0 of two_rooms is 0\.50 m wide"):
        bundle.stair_floor(0)
    with pytest.raises(ValueError, match=r"staircase 2 of two_rooms; valid: 0 … 1"):
        bundle.stair_floor(2)


def test_bundles_from_before_there_were_staircases_have_none(tmp_path: Path) -> None:
    write_two_rooms(tmp_path)
    index = json.loads((tmp_path / "scene.json").read_text())
    del index["staircases"]
    (tmp_path / "scene.json").write_text(json.dumps(index))
    assert load_bundle(tmp_path).staircases == ()


@pytest.mark.parametrize(
    ("key", "value", "reason"),
    [
        ("levels", [0, 2], "between levels 0 and 2; valid: 0 … 1, lower first"),
        ("levels", [1, 0], "between levels 1 and 0; valid: 0 … 1, lower first"),
        ("levels", [0], ""),
        ("line_world_m", [[0.0, 0.0, 0.0]], ""),
        ("line_world_m", [[0.0, 0.0], [1.0, 1.0]], ""),
        ("width_m", "wide", ""),
        ("riser_m", None, ""),
    ],
)
def test_a_damaged_index_is_refused(tmp_path: Path, key: str, value: Any, reason: str) -> None:
    with_stairs(tmp_path)
    index = json.loads((tmp_path / "scene.json").read_text())
    index["staircases"][1][key] = value
    (tmp_path / "scene.json").write_text(json.dumps(index))
    with pytest.raises(FileFormatError, match=rf"scene\.json.*{reason}"):
        load_bundle(tmp_path)


def test_damaged_treads_are_refused(tmp_path: Path) -> None:
    bundle = with_stairs(tmp_path)
    path = bundle.stair_folder(1) / "treads.npz"
    np.savez(path, center_m=np.ones((2, 3)), half_m=np.ones((1, 3)), yaw_rad=np.ones(2))
    with pytest.raises(FileFormatError, match=r"half_m of shape \(1, 3\); valid: \(2, 3\)"):
        bundle.stair_treads(1)
    path.unlink()
    with pytest.raises(FileFormatError, match="missing"):
        bundle.stair_treads(1)


@pytest.mark.parametrize("yaw_rad", [0.0, 0.3, -2.0])
def test_boxes_hold_the_points_on_them(yaw_rad: float) -> None:
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    ahead, left = np.array([c, s]), np.array([-s, c])
    first = np.array([4.0, -1.0])
    center = np.array([[*first, 0.1], [*(first + 0.3 * ahead), 0.2]])
    treads = Treads(center, np.tile([0.15, 0.5, 0.1], (2, 1)), np.full(2, yaw_rad))
    points = np.array([first, first + 0.1 * ahead - 0.49 * left, first + 0.2 * ahead])
    assert treads.holds(points).tolist() == [[True, True, False], [False, False, True]]
    assert treads.holds(points[None], 0.06).tolist() == [[[True] * 3], [[False, True, True]]]
    beside = first + 0.53 * left
    assert not treads.holds(beside).any() and treads.holds(beside, 0.05).tolist() == [True, False]
    assert len(treads.without_edge.yaw_rad) == 1
