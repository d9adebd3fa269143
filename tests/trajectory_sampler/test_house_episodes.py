"""VLN-CE episodes in a two-storey house: the stair filter and the alignment, end to end.

The episodes are made of the exact house and written as R2R-CE writes them, without our writer: y
up, −z forward, quaternions xyzw.
"""

import gzip
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.support.scenes.exact_scene import write_exact_scene
from vlnpe.apartments import TrueScene, build_scene, building_config
from vlnpe.apartments.building.stairs import eyes_on_stairs
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.vlnce.files import read_episodes
from vlnpe.pipeline.cli import main
from vlnpe.trajectory_sampler.config import SampleConfig
from vlnpe.trajectory_sampler.sampling import sample_episodes
from vlnpe.wayfinding.planning import plan_path, segments_free, simplify_path

pytestmark = [pytest.mark.chain, pytest.mark.usefixtures("inline")]

RADIUS_M = 0.30
SEED = 0


@dataclass(frozen=True)
class House:
    """The exact house and its scene."""

    home: TrueScene
    scene: SceneBundle

    def room(self, level: int, kind: str) -> np.ndarray:
        """(2,) the roomiest place in a room."""
        freemap = self.scene.freemap(level)
        room = next(r for r in self.home.storeys[level].rooms if r.kind == kind)
        rows, columns = np.indices(freemap.grid.shape)
        xy = freemap.grid.center_of(np.stack([rows, columns], -1))
        inside = np.all((xy > room.lower_m) & (xy < room.upper_m), axis=-1)
        best = np.argmax(np.where(inside, freemap.clearance_m, -1))
        return xy.reshape(-1, 2)[best]

    def path(self, level: int, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """(P, 3) waypoints of a planned way."""
        freemap = self.scene.freemap(level)
        way = plan_path(freemap, start, goal, RADIUS_M)
        assert way is not None
        return simplify_path(freemap, way, radius_m=RADIUS_M, spacing_m=1.5, tolerance_m=0.03)


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> House:
    home = build_scene(np.random.default_rng(SEED), building_config("house"), painted=False)
    scene = write_exact_scene(home, "house-0", tmp_path_factory.mktemp("scenes") / "house-0")
    return House(home, scene)


def habitat(points: np.ndarray) -> np.ndarray:
    """World z up (…, 3) → Habitat y up."""
    return points[..., [0, 2, 1]] * (1.0, 1.0, -1.0)


def facing(path_world_m: np.ndarray) -> list[float]:
    """The xyzw quaternion of Habitat that turns −z towards the path's second point."""
    ahead = habitat(path_world_m[1] - path_world_m[0])
    angle = np.arctan2(-ahead[0], -ahead[2])
    turn = Rotation.from_rotvec([0.0, angle, 0.0])
    level = ahead * (1, 0, 1)
    np.testing.assert_allclose(turn.apply([0, 0, -1]), level / np.linalg.norm(level), atol=1e-9)
    return turn.as_quat().tolist()


def record(name: int, path_world_m: np.ndarray, text: str = "Go.", **changes: Any) -> dict:
    """An episode as R2R-CE has it."""
    points = habitat(np.asarray(path_world_m, dtype=float))
    return {
        "episode_id": name,
        "trajectory_id": name,
        "scene_id": "mp3d/house-0/house-0.glb",
        "start_position": points[0].tolist(),
        "start_rotation": facing(np.asarray(path_world_m)),
        "info": {"geodesic_distance": 1.0},
        "goals": [{"position": points[-1].tolist(), "radius": 3.0}],
        "instruction": {"instruction_text": text, "instruction_tokens": [1, 2]},
        "reference_path": points.tolist(),
        **changes,
    }


def over_the_stairs(house: House, spacing_m: float) -> np.ndarray:
    """(P, 3) a path up the stairs, with points every `spacing_m`."""
    stairs = next(b for b in house.home.plan.blocks if b.kind == "stairs")
    feet = np.array(eyes_on_stairs(stairs)) - (0, 0, 1.5)
    top = house.home.storeys[1].floor_z_m
    ends = [np.append(house.room(0, "hallway"), 0.0), np.append(house.room(1, "hallway"), top)]
    corners = np.vstack([ends[0], feet, ends[1]])
    along = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))]
    at = np.linspace(0, along[-1], int(along[-1] / spacing_m) + 2)
    return np.stack([np.interp(at, along, corners[:, k]) for k in range(3)], axis=1)


def processed(
    house: House, tmp_path: Path, *records: dict, options: Sequence[str] = ()
) -> tuple[dict[str, Episode], list[str]]:
    """Filter and align a file with the commands; the episodes by id, and the ids filtered out."""
    source, kept = tmp_path / "val_unseen.json.gz", tmp_path / "kept.json.gz"
    with gzip.open(source, "wt") as stream:
        json.dump({"episodes": records}, stream)
    assert main(["filter", str(source), "--out", str(kept)]) == 0
    with gzip.open(kept, "rt") as stream:
        left = {str(e["episode_id"]) for e in json.load(stream)["episodes"]}
    out, scenes = tmp_path / "aligned.json.gz", str(house.scene.root.parent)
    arguments = ["align", str(kept), "--scenes", scenes, "--out", str(out), "--max-failed", "99"]
    assert main([*arguments, *options]) == 0
    return (
        {e.episode_id: e for e in read_episodes(out)},
        [str(r["episode_id"]) for r in records if str(r["episode_id"]) not in left],
    )


def assert_walkable(house: House, episode: Episode) -> None:
    freemap = house.scene.freemap(episode.level)
    path = episode.reference_path_world_m
    assert segments_free(freemap.grid, freemap.free(RADIUS_M), path).all()
    np.testing.assert_allclose(path[:, 2], house.home.storeys[episode.level].floor_z_m, atol=1e-3)


@pytest.mark.parametrize("level", [0, 1])
def test_flat_episodes_are_kept_on_their_own_level(house: House, tmp_path: Path, level) -> None:
    kinds = ("kitchen", "dining room") if level == 0 else ("bedroom", "study")
    kinds = [k for k in kinds if any(r.kind == k for r in house.home.storeys[level].rooms)]
    path = house.path(level, house.room(level, kinds[0]), house.room(level, "hallway"))
    # Where the sentence names stairs that nobody climbs, nothing is dropped.
    aligned, dropped = processed(house, tmp_path, record(1, path, "Walk past the stairs."))
    assert dropped == []
    assert aligned["1"].level == level
    assert_walkable(house, aligned["1"])


def test_headings_survive_both_quaternion_traps(house: House, tmp_path: Path) -> None:
    """Order xyzw, and −z forward: either mistake turns the robot away from its path."""
    center = house.room(0, "living room")
    goal = np.append(house.room(0, "hallway"), 0.0)
    yaws = np.deg2rad([0, 25, 90, 135, 180, -60, -110])
    paths = [
        np.vstack([[*center, 0.0], [*(center + 0.2 * np.array([np.cos(a), np.sin(a)])), 0.0], goal])
        for a in yaws
    ]
    records = [record(k, path) for k, path in enumerate(paths)]
    # The same rotation with all signs turned.
    records += [{**r, "episode_id": 100 + r["episode_id"],
                 "start_rotation": [-v for v in r["start_rotation"]]} for r in records]  # fmt: skip
    aligned, _ = processed(house, tmp_path, *records)
    for k, yaw in enumerate(yaws):
        for name in (str(k), str(100 + k)):
            turned = aligned[name].start_yaw_rad - yaw
            assert abs(np.angle(np.exp(1j * turned))) < 1e-6, (name, np.rad2deg(turned))
    # The published example: [0, 0.5, 0, 0.866] is a turn of 60° to the left of −z.
    known = {**records[0], "episode_id": 7, "start_rotation": [0.0, 0.5, 0.0, 0.8660254]}
    aligned, _ = processed(house, tmp_path, known)
    assert np.rad2deg(aligned["7"].start_yaw_rad) == pytest.approx(150.0, abs=1e-3)


def test_stair_episodes_are_dropped_up_and_down(house: House, tmp_path: Path) -> None:
    up = over_the_stairs(house, 1.2)
    assert np.abs(np.diff(up[:, 2])).max() > 0.3
    flat = house.path(1, house.room(1, "bedroom"), house.room(1, "hallway"))
    aligned, dropped = processed(
        house, tmp_path, record(1, up), record(2, up[::-1]), record(3, flat)
    )
    assert dropped == ["1", "2"]
    assert list(aligned) == ["3"]


def test_stairs_in_small_steps_never_become_an_episode(house: House, tmp_path: Path) -> None:
    """Points every 25 cm climb less than 0.3 m each, so the public rule alone keeps them."""
    up = over_the_stairs(house, 0.25)
    assert np.abs(np.diff(up[:, 2])).max() < 0.3
    aligned, _ = processed(house, tmp_path, record(1, up), record(2, up[::-1]))
    assert aligned == {}


def test_a_path_over_the_stairwell_goes_around_it(house: House, tmp_path: Path) -> None:
    """Both ends on the upper floor, the straight way over the void."""
    plan = house.home.storeys[1]
    void = next(b for b in plan.blocks if b.kind == "void")
    hall = house.path(1, house.room(1, "hallway"), house.room(1, "stairwell"))
    middle = np.append(void.rect().mean(0), plan.floor_z_m)
    near = hall[-1] + 0.35 * (middle - hall[-1]) / np.linalg.norm(middle - hall[-1])
    aligned, _ = processed(house, tmp_path, record(1, np.vstack([hall[0], near, hall[-1]])))
    assert_walkable(house, aligned["1"])
    freemap = house.scene.freemap(1)
    assert not freemap.traversable[tuple(freemap.grid.cell_of(middle[:2]))]


def test_a_waypoint_over_the_void_is_bypassed_and_recorded(house: House, tmp_path: Path) -> None:
    plan = house.home.storeys[1]
    void = next(b for b in plan.blocks if b.kind == "void")
    middle = np.append(void.rect().mean(0), plan.floor_z_m)
    hall = house.path(1, house.room(1, "hallway"), house.room(1, "stairwell"))
    inner = len(hall) // 2 + 1
    assert len(hall) >= 3
    path = np.vstack([hall[:inner], middle, hall[inner:]])
    aligned, _ = processed(house, tmp_path, record(1, path))
    changes = aligned["1"].extra["alignment"]
    assert [one["waypoint"] for one in changes["bypassed"]] == [inner]
    np.testing.assert_allclose(changes["bypassed"][0]["position_world_m"], middle, atol=2e-3)
    assert_walkable(house, aligned["1"])


def test_goals_in_collision_are_refused_unless_that_is_allowed(
    house: House, tmp_path: Path
) -> None:
    """20 cm from a wall are less than the robot needs; the start stands free and stays."""
    path = house.path(0, house.room(0, "living room"), house.room(0, "hallway"))
    freemap = house.scene.freemap(0)
    tight = np.argwhere(freemap.traversable & (np.abs(freemap.clearance_m - 0.2) < 0.03))
    places = freemap.grid.center_of(tight)
    goal = places[np.argmin(np.linalg.norm(places - path[-1, :2], axis=1))]
    walked = record(1, np.vstack([path, [*goal, 0.0]]))
    assert processed(house, tmp_path, walked)[0] == {}
    loose = processed(house, tmp_path, walked, options=("--goal-beyond-start",))[0]
    assert 0.0 < loose["1"].extra["alignment"]["goal_moved_m"] <= 0.5


def test_bad_starts_are_moved_or_refused(house: House, tmp_path: Path) -> None:
    plan = house.home.plan
    living = next(r for r in plan.rooms if r.kind == "living room")
    path = house.path(0, house.room(0, "living room"), house.room(0, "hallway"))
    freemap = house.scene.freemap(0)
    rows, columns = np.indices(freemap.grid.shape)
    xy = freemap.grid.center_of(np.stack([rows, columns], -1))
    inside = np.all((xy > living.lower_m) & (xy < living.upper_m), axis=-1)
    # 20 cm of clearance are less than the robot needs, but not hopeless.
    tight = inside & (np.abs(freemap.clearance_m - 0.2) < 0.03)
    moved = np.vstack([[*xy[tight][0], 0.0], path])
    outside = np.vstack([[*(plan.bounds()[0] - 3.0), 0.0], path])
    in_the_air = path + np.array([0.0, 0.0, 1.4])
    aligned, dropped = processed(
        house, tmp_path, record(1, moved), record(2, outside), record(3, in_the_air)
    )
    assert dropped == []
    assert list(aligned) == ["1"]
    assert 0.0 < aligned["1"].extra["alignment"]["start_moved_m"] <= 0.5
    assert_walkable(house, aligned["1"])


def test_a_straight_way_through_walls_becomes_a_detour(house: House, tmp_path: Path) -> None:
    start, goal = house.room(0, "kitchen"), house.room(0, "bathroom")
    line = np.array([[*start, 0.0], [*goal, 0.0]])
    freemap = house.scene.freemap(0)
    assert not segments_free(freemap.grid, freemap.free(RADIUS_M), line).all()
    aligned, _ = processed(house, tmp_path, record(1, line))
    assert aligned["1"].extra["alignment"]["detours"] >= 1
    assert_walkable(house, aligned["1"])


def test_sampled_episodes_never_leave_their_level(house: House) -> None:
    config = SampleConfig(count=10, robot_radius_m=RADIUS_M)
    result = sample_episodes(house.scene, config, np.random.default_rng(1))
    floors = [plan.floor_z_m for plan in house.home.storeys]
    assert {e.level for e in result.episodes} == {0, 1}
    for episode in result.episodes:
        heights = episode.reference_path_world_m[:, 2]
        np.testing.assert_allclose(heights, floors[episode.level], atol=0.01)
        assert_walkable(house, episode)
        for storey in house.home.storeys:
            for block in storey.blocks:
                low, high = block.rect()
                points = episode.reference_path_world_m[:, :2]
                assert not np.all((points > low) & (points < high), axis=1).any()
