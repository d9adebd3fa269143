"""VLN-CE episodes over stairs: kept for robots that climb, and fitted into their scene."""

import gzip
import json
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.scenes.storeys import HEAD_X, LINE, TOP_M, write_two_storeys
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.errors import InputError, SceneError
from vlnpe.formats.core.geometry import path_length, resample
from vlnpe.formats.scene import FULL_HEIGHT_M
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.scene.sheet import save_sheet
from vlnpe.formats.vlnce.files import VlnceFile, read_vlnce
from vlnpe.pipeline.inputs.sampling_plan import climber_height
from vlnpe.trajectory_sampler.config import CROSS, SampleConfig
from vlnpe.trajectory_sampler.sampling import sample_episodes
from vlnpe.trajectory_sampler.vlnce.align import align_episodes
from vlnpe.trajectory_sampler.vlnce.align_config import AlignConfig
from vlnpe.trajectory_sampler.vlnce.stairs import GEOMETRIC, STEP, StairRules, filter_stairs
from vlnpe.wayfinding.legs import legs_of

UP = np.vstack([[2.0, 2.0, 0.0], [6.0, 2.0, 0.0], LINE, [HEAD_X + 7.0, 2.0, TOP_M]])
FLAT = np.array([[1.0, 1.0, 0.0], [4.0, 1.0, 0.0]])
# Up through the ceiling, where there are no stairs.
LAMP_XY = LINE[1:3, :2].mean(axis=0)
ELSEWHERE = np.array([[2.0, 2.0, 0.0], [2.0, 3.0, 1.0], [HEAD_X + 7.0, 3.0, TOP_M]])
SPLIT = np.array([[2.0, 2.0, 0.0], [3.0, 2.0, 0.6], [4.0, 2.0, 0.0]])
PATHS = {
    "up": resample(UP, 0.8),
    "down": resample(UP[::-1], 1.1),
    "sparse": UP[[0, 1, 2, -2, -1]],
    "flat": FLAT,
    "elsewhere": ELSEWHERE,
    "split": SPLIT,
}


@pytest.fixture(scope="module")
def building(tmp_path_factory: pytest.TempPathFactory) -> SceneBundle:
    return write_two_storeys(tmp_path_factory.mktemp("scenes") / "house")


def record(name: str, path: np.ndarray) -> dict[str, Any]:
    """An episode as R2R-CE has it, y up."""
    points = (path[:, [0, 2, 1]] * (1.0, 1.0, -1.0)).tolist()
    return {
        "episode_id": name,
        "trajectory_id": name,
        "scene_id": "mp3d/house/house.glb",
        "start_position": points[0],
        "start_rotation": [0.0, 0.0, 0.0, 1.0],
        "info": {"geodesic_distance": 1.0},
        "goals": [{"position": points[-1], "radius": 3.0}],
        "instruction": {"instruction_text": "Go.", "instruction_tokens": [1]},
        "reference_path": points,
    }


def written(folder: Path, paths: Mapping[str, np.ndarray], *more: dict[str, Any]) -> Path:
    path = folder / "val_unseen.json.gz"
    with gzip.open(path, "wt") as stream:
        json.dump({"episodes": [*(record(*entry) for entry in paths.items()), *more]}, stream)
    return path


def some(*names: str) -> dict[str, np.ndarray]:
    return {name: PATHS[name] for name in names}


def kept(file: VlnceFile) -> set[str]:
    return {str(episode.episode_id) for episode in file.episodes}


@pytest.mark.parametrize("rule", [STEP, GEOMETRIC])
def test_climbable_episodes_are_kept_for_those_who_climb(
    building: SceneBundle, tmp_path: Path, rule: str
) -> None:
    file, scenes = read_vlnce(written(tmp_path, PATHS)), {"house": building}
    plain = filter_stairs(file, StairRules((rule,)), scenes)
    assert kept(plain.kept) == {"flat"} | ({"split"} if rule == GEOMETRIC else set())
    result = filter_stairs(file, StairRules((rule,), climber_radius_m=0.3), scenes)
    assert kept(result.kept) == kept(plain.kept) | {"up", "down", "sparse"}
    assert result.counts.climbable == (3, 3)
    assert result.counts.by_rule == plain.counts.by_rule
    reasons = {str(d.episode_id): d.reasons["climbable"] for d in result.dropped}
    assert "staircase 0 is a spiral; staircase 1 is" in reasons["elsewhere"]
    assert rule == GEOMETRIC or "starts and ends on level 0" in reasons["split"]
    wide = filter_stairs(file, StairRules((rule,), climber_radius_m=0.7), scenes)
    assert kept(wide.kept) == kept(plain.kept)
    assert "staircase 1 is 1.20 m wide" in wide.dropped[0].reason


def test_what_is_climbable_cannot_be_said_without_scenes(tmp_path: Path) -> None:
    file = read_vlnce(written(tmp_path, PATHS))
    with pytest.raises(InputError, match="--keep-climbable needs repaired scenes"):
        filter_stairs(file, StairRules(climber_radius_m=0.3))


@pytest.mark.parametrize("name", ["up", "down", "sparse"])
def test_climbable_episodes_are_aligned_along_the_middle_of_the_stairs(
    building: SceneBundle, tmp_path: Path, name: str
) -> None:
    file, scenes = read_vlnce(written(tmp_path, some(name, "flat"))), {"house": building}
    plain = align_episodes(file, scenes)
    assert [e.episode_id for e in plain.episodes] == ["flat"]
    result = align_episodes(file, scenes, AlignConfig(keep_climbable=True))
    episode, flat = result.episodes
    assert str(flat) == str(plain.episodes[0])
    levels = (1, 0) if name == "down" else (0, 1)
    assert (episode.levels, episode.staircases, episode.level) == (levels, (1,), levels[0])
    path = PATHS[name]
    assert episode.start_position_world_m == pytest.approx(path[0])
    assert episode.goal_position_world_m == pytest.approx(path[-1])
    stairs = legs_of(building, episode)[1]
    assert np.array_equal(stairs.path_m, LINE if name != "down" else LINE[::-1])
    assert episode.geodesic_distance_m == pytest.approx(path_length(UP), abs=0.15)
    assert episode.reference_length_m <= 1.05 * path_length(UP)


def test_paths_that_no_staircase_takes_are_rejected_with_the_reason(
    building: SceneBundle, tmp_path: Path
) -> None:
    file = read_vlnce(written(tmp_path, some("elsewhere", "split", "flat")))
    config = AlignConfig(keep_climbable=True, max_floor_gap_m=0.4)
    reasons = dict(align_episodes(file, {"house": building}, config).rejected)
    assert "staircase 0 is a spiral; staircase 1 is" in reasons["elsewhere"]
    assert "takes no staircase" in reasons["split"]


def test_paths_that_start_or_end_on_the_stairs_are_neither_kept_nor_aligned(
    building: SceneBundle, tmp_path: Path
) -> None:
    on_stairs = LINE[1] + 0.15 * (LINE[2] - LINE[1])
    starts = np.vstack([on_stairs, UP[4:]])
    paths = {"starts": starts, "ends": starts[::-1], "up": PATHS["up"]}
    file, scenes = read_vlnce(written(tmp_path, paths)), {"house": building}
    result = filter_stairs(file, StairRules(climber_radius_m=0.3), scenes)
    assert kept(result.kept) == {"up"}
    aligned = align_episodes(file, scenes, AlignConfig(keep_climbable=True))
    assert [e.episode_id for e in aligned.episodes] == ["up"]
    for reasons in ({str(d.episode_id): d.reason for d in result.dropped}, dict(aligned.rejected)):
        assert "it starts on the stairs" in reasons["starts"]
        assert "it ends on the stairs" in reasons["ends"]


@pytest.mark.parametrize(("height_m", "reason"), [(FULL_HEIGHT_M, "is not reached"), (0.65, "")])
def test_the_filter_judges_the_points_and_the_height_of_the_alignment(
    tmp_path: Path, height_m: float, reason: str
) -> None:
    bundle = write_two_storeys(tmp_path / "house")
    sheet = bundle.freemap(0)
    xs = sheet.grid.center_of(np.moveaxis(np.indices(sheet.grid.shape), 0, -1))[..., 0]
    table = np.abs(xs - 7.0) < 0.2  # from wall to wall, 0.8 m high
    headroom = np.where(table & sheet.traversable, np.float32(0.8), sheet.headroom_m)
    sheet = replace(sheet, traversable=sheet.traversable & ~table, headroom_m=headroom)
    save_sheet(bundle.level_folder(0), bundle.floor(0), bundle.obstacles(0), sheet)
    floats = record("floats", PATHS["up"])
    floats["goals"][0]["position"] = [HEAD_X + 7.0, TOP_M + 1.5, -2.0]
    file = read_vlnce(written(tmp_path, some("up"), floats))
    rules = StairRules(climber_radius_m=0.3, free_height_m=height_m)
    filtered = filter_stairs(file, rules, {"house": bundle})
    config = AlignConfig(keep_climbable=True, free_height_m=height_m)
    aligned = align_episodes(file, {"house": bundle}, config)
    dropped = {str(d.episode_id): d.reason for d in filtered.dropped}
    for reasons in (dropped, dict(aligned.rejected)):
        assert "its goal lies on no level's floor" in reasons["floats"]
        assert reason in reasons.get("up", "")
        assert ("up" in reasons) == bool(reason)


@pytest.mark.parametrize(
    ("robot", "reason"), [("aliengo", ""), ("vlnce", "not free along its middle, 1.56 m")]
)
def test_only_who_fits_under_a_lamp_is_sent_over_the_treads_beneath(
    tmp_path: Path, robot: str, reason: str
) -> None:
    bundle = with_lamp(write_two_storeys(tmp_path / "house"))
    file, scenes = read_vlnce(written(tmp_path, some("up"))), {"house": bundle}
    height_m = climber_height([get_robot(robot)])
    rules = StairRules(climber_radius_m=0.3, climb_height_m=height_m)
    filtered = filter_stairs(file, rules, scenes)
    config = AlignConfig(keep_climbable=True, climb_height_m=height_m)
    aligned = align_episodes(file, scenes, config)
    dropped = {str(d.episode_id): d.reason for d in filtered.dropped}
    for reasons in (dropped, dict(aligned.rejected)):
        assert reason in reasons.get("up", "")
        assert ("up" in reasons) == bool(reason)
    crossing = SampleConfig(count=1, storeys=CROSS, climb_height_m=height_m)
    with pytest.raises(SceneError, match=reason) if reason else nullcontext():
        (episode,) = sample_episodes(bundle, crossing, np.random.default_rng(0)).episodes
        assert episode.climb_height_m == height_m
        assert len(legs_of(bundle, episode)) == 3


def with_lamp(bundle: SceneBundle) -> SceneBundle:
    """Hang a lamp 1 m above a tread."""
    sheet = bundle.stair_freemap(1)
    gap = np.abs(sheet.grid.center_of(np.moveaxis(np.indices(sheet.grid.shape), 0, -1)) - LAMP_XY)
    lamp = sheet.traversable & (gap.max(axis=-1) < 0.15)
    headroom = np.where(lamp, np.float32(1.0), sheet.headroom_m)
    sheet = replace(sheet, traversable=sheet.traversable & ~lamp, headroom_m=headroom)
    save_sheet(bundle.stair_folder(1), bundle.stair_floor(1), bundle.stair_obstacles(1), sheet)
    return bundle


def test_an_episode_that_cannot_be_read_in_its_scene_costs_no_other(
    building: SceneBundle, tmp_path: Path
) -> None:
    damaged = write_two_storeys(tmp_path / "house")
    (damaged.stair_folder(1) / "freemap.npz").write_bytes(b"no archive")
    file = read_vlnce(written(tmp_path, some("up", "flat")))
    result = align_episodes(file, {"house": damaged}, AlignConfig(keep_climbable=True))
    assert [e.episode_id for e in result.episodes] == ["flat"]
    assert "stairs/1/freemap.npz" in dict(result.rejected)["up"]


@pytest.mark.parametrize(("edge_x", "problem"), [(10.25, ""), (9.9, "an obstacle stands between")])
@pytest.mark.parametrize("y", [3.1, 3.4])
def test_the_way_to_the_stairs_cuts_no_corner(
    tmp_path: Path, y: float, edge_x: float, problem: str
) -> None:
    bundle = write_two_storeys(tmp_path / "house")
    floor, boxes, sheet = bundle.floor(0), bundle.obstacles(0), bundle.freemap(0)
    # The stairs are an obstacle on their level.
    cells_m = sheet.grid.center_of(np.moveaxis(np.indices(sheet.grid.shape), 0, -1))
    stairs = (cells_m[..., 0] > edge_x) & (np.abs(cells_m[..., 1] - 2.0) < 0.6)
    sheet = replace(sheet, traversable=sheet.traversable & ~stairs)
    save_sheet(bundle.level_folder(0), floor, boxes, sheet)
    path = np.vstack([UP[:2], [9.9, y, 0.0], UP[2:]])
    result = align_episodes(
        read_vlnce(written(tmp_path, {"corner": path})),
        {"house": bundle},
        AlignConfig(keep_climbable=True),
    )
    assert [e.episode_id for e in result.episodes] == ([] if problem else ["corner"])
    assert problem in dict(result.rejected).get("corner", "")
    for episode in result.episodes:
        points = resample(legs_of(bundle, episode)[0].path_m, 0.02)[:, :2]
        on_level, on_stairs = (
            freemap.free(0.3)[tuple(freemap.grid.clamped_cell_of(points).T)]
            for freemap in (sheet, bundle.stair_freemap(1))
        )
        assert np.all(on_level | on_stairs)
