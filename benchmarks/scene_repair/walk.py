"""A robot walks over planted holes: on the floor as scanned, and on the floor as repaired.

Neither floor is the one that the repair hands to the simulator, which is closed around scanned
cells by design and cannot have small holes. Both are made from exported triangles alone, in one
way: a vertical ray every 2 cm; where it meets a surface there is floor at that height, where
neither it nor any of its eight neighbours meets one there is a pit half a metre deep. A hole is so
never larger for a foot than it is in the scan. Obstacles and the planning map are the repaired
scene's in both worlds, so nothing else differs.
"""

import math
import shutil
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from vlnpe.collectors.replay.replay import ReplayConfig, replay_in
from vlnpe.collectors.replay.world import World, open_world
from vlnpe.collectors.robots import RobotSpec, get_robot
from vlnpe.formats.core.arrays import Array, Floats, Mask
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.rollout import EndReason
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.scene_repair.repair import repair_scene

from .cases import CONFIG
from .planting.plant import Planted, PlantedHole, plant
from .scenes import Source, apartment, write_planted
from .score import in_world
from .site import Site, cell_centers, soup_of
from .vertical import Surfaces, heights_near

ROBOT = "aliengo"
KINDS_WALKED = ("round", "concave", "ring", "round", "crack")
# Large enough for a foot of 5 cm, which a stride may still miss; a crack's width is its own.
SIZES_M = (0.3, 1.0)
RUN_UP_M = 0.9
CELL_M = 0.02
PIT_M = 0.5
# Legs stand this far from the middle: the line is shifted so that some step over the hole's middle.
TRACK_M = 0.134
# Room that the robot needs on both sides.
CLEAR_M = 0.36
PER_SCENE = 9


@dataclass(frozen=True)
class Walk:
    """One walk over one hole.

    Attributes:
        scene: where.
        hole: name of the hole.
        size_m: its longest side.
        raw, repaired: how it ended on the two floors.
    """

    scene: str
    hole: str
    size_m: float
    raw: str
    repaired: str


def walks(seeds: tuple[int, ...], cache: Path, folder: Path, count: int = 50) -> list[Walk]:
    """Plant holes in open floor of apartments and walk over them until there are enough walks."""
    robot = get_robot(ROBOT)
    done: list[Walk] = []
    for seed in seeds:
        rng = np.random.default_rng(10_000 + seed)
        source = apartment(seed, cache)
        planted = plant(
            source.site, rng, PER_SCENE, (), KINDS_WALKED, SIZES_M, _open_floor(source.site)
        )
        done += _walked(source, planted, robot, folder / f"walk-{seed}")
        if len(done) >= count:
            break
    return done[:count]


def table(walks: list[Walk]) -> list[str]:
    """Return a Markdown table."""
    lines = ["| | walks | arrived | falls | stuck | share of falls |"]
    lines.append("| --- | ---: | ---: | ---: | ---: | ---: |")
    for name in ("raw", "repaired"):
        ends = Counter(getattr(walk, name) for walk in walks)
        falls = ends[EndReason.FALL]
        lines.append(
            f"| {name} scan | {len(walks)} | {ends[EndReason.SUCCESS]} | {falls} "
            f"| {ends[EndReason.STUCK] + ends[EndReason.TIMEOUT]} "
            f"| {100 * falls / max(len(walks), 1):.0f} % |"
        )
    return lines


def _open_floor(site: Site) -> Mask:
    """Return the cells around which a robot has room."""
    free = site.true_floor & site.scanned & ~site.furniture & ~site.wall
    return np.asarray(ndimage.distance_transform_edt(free)) * site.grid.cell_m > CLEAR_M + 0.1


def _walked(source: Source, planted: Planted, robot: RobotSpec, out: Path) -> list[Walk]:
    shutil.rmtree(out, ignore_errors=True)
    (out / "bundle").mkdir(parents=True)
    scan = write_planted(planted, source, out)
    bundle = repair_scene(scan, out / "bundle", CONFIG, lambda _: None)
    level = int(np.argmin(np.abs(np.array(bundle.level_floor_z_m) - planted.site.floor_z_m)))
    lines = [(hole, _line(planted.site, bundle, level, hole)) for hole in planted.holes]
    lines = [(hole, line) for hole, line in lines if line is not None]
    if not lines:
        return []
    vertices, faces = soup_of(planted.parts)
    visual = bundle.visual()
    raw = _world(bundle, level, in_world(vertices, bundle), faces, robot, out / "raw")
    repaired = _world(bundle, level, visual.vertices, visual.faces, robot, out / "repaired")
    config = ReplayConfig(robot=ROBOT, controller="path")
    result = []
    for hole, line in lines:
        episode = _episode(bundle, level, hole, line)
        ends = [replay_in(world, episode, config).end_reason for world in (raw, repaired)]
        result.append(Walk(planted.site.name, hole.name, hole.size_m, *(e.value for e in ends)))
    return result


def _world(
    bundle: SceneBundle,
    level: int,
    vertices: Floats,
    faces: NDArray[np.integer],
    robot: RobotSpec,
    root: Path,
) -> World:
    """Return the level over the floor that the triangles have, pits where they have none."""
    shutil.copytree(bundle.level_folder(level), root / "levels" / str(level))
    old = bundle.floor(level).grid
    lower = np.asarray(old.origin_xy_m)
    grid = GridSpec.covering(lower, lower + np.array([old.columns, old.rows]) * old.cell_m, CELL_M)
    z = bundle.level_floor_z_m[level]
    near = Surfaces.between(vertices, faces, z - 0.1, z + 0.1)
    heights = heights_near(near, cell_centers(grid), z, 0.08).reshape(grid.shape)
    floor = np.isfinite(heights)
    nearest = ndimage.distance_transform_edt(~floor, return_distances=False, return_indices=True)
    height = heights[tuple(np.asarray(nearest))]
    height = np.where(ndimage.binary_dilation(floor, np.ones((3, 3))), height, z - PIT_M)
    np.savez(
        root / "levels" / str(level) / "floor.npz",
        origin_xy_m=np.asarray(grid.origin_xy_m),
        cell_m=np.float64(grid.cell_m),
        shape=np.asarray(grid.shape),
        height_m=height.astype(np.float32),
        covered=np.ones(grid.shape, dtype=bool),
    )
    return open_world(replace(bundle, root=root), level, robot)


def _line(site: Site, bundle: SceneBundle, level: int, hole: PlantedHole) -> Array | None:
    """Return world ends (2, 2) of a free straight line on which feet step over the hole."""
    freemap = bundle.freemap(level)
    clear = np.asarray(ndimage.distance_transform_edt(freemap.traversable)) * freemap.grid.cell_m
    points = np.concatenate(hole.outline.rings)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    best, best_clear = None, CLEAR_M
    for angle in np.linspace(0, math.pi, 16, endpoint=False):
        along = np.array([math.cos(angle), math.sin(angle)])
        aside = np.array([-along[1], along[0]])
        reach = np.abs((points - middle) @ along).max() + RUN_UP_M
        across = np.abs((points - middle) @ aside).max()
        # Over a ring the feet must meet the ring, not its island.
        shift = TRACK_M if len(hole.outline.rings) == 1 else max(across - 0.1, TRACK_M)
        ends = middle + shift * aside + np.array([[-reach], [reach]]) * along
        at = np.linspace(ends[0], ends[1], 60)
        high = np.column_stack([at, np.full(len(at), site.floor_z_m)])
        world = in_world(high, bundle)[:, :2]
        cells = freemap.grid.cell_of(world)
        if not freemap.grid.inside(cells).all():
            continue
        room = float(clear[tuple(cells.T)].min())
        if room > best_clear:
            best, best_clear = world[[0, -1]], room
    return best


def _episode(bundle: SceneBundle, level: int, hole: PlantedHole, line: Array) -> Episode:
    path = np.column_stack([line, np.full(2, bundle.level_floor_z_m[level])])
    dx, dy = line[1] - line[0]
    return Episode(
        episode_id=hole.name,
        trajectory_id=hole.name,
        scene_id=bundle.scene_id,
        split="train",
        level=level,
        start_position_world_m=path[0],
        start_yaw_rad=math.atan2(dy, dx),
        goal_position_world_m=path[1],
        reference_path_world_m=path,
        geodesic_distance_m=float(np.hypot(dx, dy)),
    )
