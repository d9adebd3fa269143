"""Stairs as the policy `map` takes them: by what it sees, in halls whose treads are known."""

import math

import numpy as np
import pytest
import trimesh

from tests.support.scenes.stair_halls import StairHall, stair_hall
from vlnpe.evaluation.observation import Lens
from vlnpe.evaluation.policies.map_policy.climb import Climb
from vlnpe.evaluation.policies.map_policy.flights import find_flight
from vlnpe.evaluation.policies.map_policy.seen_map import CELL_M, HALF_M, SeenMap, behind_walls
from vlnpe.formats.core.camera import CameraModel
from vlnpe.formats.core.rollout import FORWARD_STEP_M, TURN_STEP_RAD, Action
from vlnpe.formats.scene.grid import GridSpec

CAMERA = CameraModel("eye", width_px=160, height_px=160, hfov_deg=90.0)
EYE_M, EYE_AHEAD_M = 0.45, 0.3


class Puppet:
    """Stands on whatever is below it, sees by depth, and does exactly what it is told."""

    def __init__(self, parts: list[trimesh.Trimesh], place_m, yaw_rad: float) -> None:
        mesh = trimesh.util.concatenate(parts)
        assert isinstance(mesh, trimesh.Trimesh)
        self.rays_through = mesh.ray
        self.place_m, self.yaw_rad = np.array(place_m, dtype=np.float64), yaw_rad
        rows, columns = np.indices((CAMERA.height_px, CAMERA.width_px))
        k = CAMERA.intrinsics
        self.rays = np.stack(
            [(columns - k[0, 2]) / k[0, 0], (rows - k[1, 2]) / k[1, 1], np.ones(rows.shape)], -1
        ).reshape(-1, 3)

    @property
    def pose(self) -> np.ndarray:
        return np.array([*self.place_m[:2], self.yaw_rad])

    def look(self) -> tuple[np.ndarray, Lens]:
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        level = np.array([[sin, 0.0, cos], [-cos, 0.0, sin], [0.0, -1.0, 0.0]])
        tip = math.radians(10.0)
        down = np.array(
            [[1, 0, 0], [0, math.cos(tip), math.sin(tip)], [0, -math.sin(tip), math.cos(tip)]]
        )
        rotation = level @ down
        eye = self.place_m + np.array([EYE_AHEAD_M * cos, EYE_AHEAD_M * sin, EYE_M])
        directions = self.rays @ rotation.T
        hit, ray, _ = self.rays_through.intersects_location(
            np.tile(eye, (len(directions), 1)), directions, multiple_hits=False
        )
        depth = np.zeros(len(directions), np.float32)
        depth[ray] = (hit - eye) @ rotation[:, 2]
        return depth.reshape(CAMERA.height_px, CAMERA.width_px), Lens(CAMERA, eye, rotation)

    def do(self, action: Action) -> None:
        if action is not Action.FORWARD:
            self.yaw_rad += TURN_STEP_RAD * (1 if action is Action.LEFT else -1)
            return
        ahead = np.array([math.cos(self.yaw_rad), math.sin(self.yaw_rad), 0.0])
        place = self.place_m + FORWARD_STEP_M * ahead
        over = place + np.array([0.0, 0.0, 0.3])
        hit, *_ = self.rays_through.intersects_location(
            [over], [[0.0, 0.0, -1.0]], multiple_hits=False
        )
        assert len(hit), f"there is no floor at {place}"
        assert abs(hit[0, 2] - place[2]) < 0.4, f"a drop at {place}"
        self.place_m = np.array([*place[:2], hit[0, 2]])


def ends_of(hall: StairHall) -> tuple[np.ndarray, np.ndarray]:
    """Return the foot and the head (3,), and unit vectors (2, 2) along the first and last run."""
    middles = hall.treads.mean(axis=1)
    first, last = middles[1] - middles[0], middles[-1] - middles[-2]
    ends = np.array([[*hall.foot_m, 0.0], [*hall.head_m, hall.rise_m]])
    return ends, np.array([first / np.linalg.norm(first), last / np.linalg.norm(last)])


@pytest.mark.parametrize(
    ("shape", "way", "signs", "edge_m"),
    [
        ("straight", "up", (1.0,), -25.0),
        ("straight", "up", (1.0, -1.0), 0.9),  # the map begins beside the stairs
        ("straight", "down", (-1.0,), 2.1 - 2 * HALF_M),  # or ends there
        ("L", "up", (1.0,), -25.0),
        ("L", "down", (1.0, -1.0), -25.0),
        ("U", "up", (1.0, -1.0), -25.0),
        ("U", "down", (-1.0,), -25.0),
    ],
)
def test_it_takes_the_stairs_that_it_sees(
    shape: str, way: str, signs: tuple[float, ...], edge_m: float
) -> None:
    hall = stair_hall(shape)
    ends, runs = ends_of(hall)
    start, ahead = (ends[0], runs[0]) if way == "up" else (ends[1], -runs[1])
    aside = np.array([-ahead[1], ahead[0]])
    place = start + np.array([*(-0.6 * ahead + 0.2 * aside), 0.0])
    puppet = Puppet(hall.parts, place, math.atan2(ahead[1], ahead[0]) + 0.3)
    cells = round(2 * HALF_M / CELL_M)
    seen = SeenMap(place[2], GridSpec((edge_m, -HALF_M), CELL_M, cells, cells))
    turned_on_treads = 0
    climb = Climb(signs, 0.3, np.random.default_rng(0), [])
    action = Action.FORWARD
    for _ in range(150):
        seen.add(*puppet.look(), puppet.pose[:2])
        action = climb.act(seen, puppet.pose, float(puppet.place_m[2] - place[2]))
        if action is None:
            break
        on = np.all(
            (puppet.place_m[:2] > hall.treads[:, 0]) & (puppet.place_m[:2] < hall.treads[:, 1]), 1
        )
        flat = hall.landing >= 0 and on[hall.landing]
        turned_on_treads += bool(on.any() and not flat and action is not Action.FORWARD)
        puppet.do(action)
    other = ends[1] if way == "up" else ends[0]
    assert abs(puppet.place_m[2] - other[2]) < 0.02 and action is None
    assert np.linalg.norm(puppet.place_m[:2] - other[:2]) < 1.0
    assert len(climb.flights) == (1 if shape == "straight" else 2)
    assert turned_on_treads <= 4


def test_a_table_with_a_shelf_is_no_flight() -> None:
    boxes = [trimesh.creation.box(bounds=[[-4, -4, -0.1], [4, 4, 0.0]])]
    boxes.append(trimesh.creation.box(bounds=[[1.5, -0.5, 0.15], [2.3, 0.5, 0.18]]))
    boxes.append(trimesh.creation.box(bounds=[[1.5, -0.5, 0.40], [2.3, 0.5, 0.43]]))
    puppet, seen = Puppet(boxes, (0.0, 0.0, 0.0), 0.0), SeenMap()
    seen.add(*puppet.look(), puppet.pose[:2])
    places = seen.heights.steps(np.zeros(2), 0.0, 6.0)
    assert len(places) > 100
    assert find_flight(places, 0.0, 1.0, np.random.default_rng(0)) is None


@pytest.mark.parametrize("beyond_m", [2.0, 9.0])
def test_nothing_is_on_the_other_edge_of_the_map(beyond_m: float) -> None:
    seen = SeenMap()
    along = np.linspace(-HALF_M, HALF_M, 500, endpoint=False)
    floor = np.stack([*np.meshgrid(along, along), np.zeros((500, 500))], -1).reshape(-1, 3)
    seen.heights.add(floor)
    for side in (-1.0, 1.0):
        outside = np.array([side * (HALF_M + beyond_m), 0.0])
        assert not len(seen.heights.steps(outside, 0.0, 7.0))
        cells = seen.grid.cell_of(outside[None])
        assert not seen.heights.between(np.array([-0.1]), np.array([0.1]), cells).any()
        assert not behind_walls(seen, outside[None], np.zeros((1, 2))).any()
