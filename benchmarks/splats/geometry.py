"""Score geometry made from generated splats: `python -m benchmarks.splats.geometry SEED…`.

Each capture is generated, repaired and compared with the exact building: height of the floor,
places of walls, free floor that is free, doors that are open, furniture that is an obstacle.
"""

import argparse
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import ndimage
from skimage.measure import label

from vlnpe.apartments import build_scene, building_config
from vlnpe.apartments.building.shell import wall_frame
from vlnpe.apartments.building.true_scene import TrueScene
from vlnpe.apartments.generate_splats import generate_splats
from vlnpe.apartments.scanner.lookup import exact_surface
from vlnpe.apartments.scanner.tracing import Tracer
from vlnpe.apartments.truth import covered_cells, true_floor
from vlnpe.formats.core.arrays import Array, Mask
from vlnpe.formats.core.geometry import triangle_normals, triangle_normals_and_areas
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.scene_repair.splats.repair import repair_splats

# Between these heights above the floor anything is an obstacle.
LOW_M, HIGH_M = 0.06, 1.9
NO_OBSTACLES = {"floor", "wall", "ceiling", "rug", "carpet", "door", "window", "lamp", "curtain"}
THICK_M = 0.05
SAMPLES = 40_000


@dataclass(frozen=True)
class Score:
    """One row; see `HEAD`."""

    floor_mm: float
    floor_95_mm: float
    wall_mm: float
    free: float
    doors: int
    doors_closed: int
    things: int
    missed: tuple[str, ...]
    sound: bool


HEAD = (
    "| seed | floor median mm | floor 95 % mm | wall median mm | free floor free % | doors closed "
    "| obstacles missed | sound | CPU s |\n|---|---|---|---|---|---|---|---|---|\n"
)


def obstacle_cells(grid: GridSpec, triangles_m: Array) -> Mask:
    """Return the cells that triangles between `LOW_M` and `HIGH_M` cover, seen from above."""
    z = triangles_m[..., 2]
    return covered_cells(grid, triangles_m[(z.max(1) > LOW_M) & (z.min(1) < HIGH_M)])


def reachable(free: Mask) -> Mask:
    """Return the free cells in one piece with most others, less those beside an obstacle.

    The floor inside a closed wardrobe or refrigerator is none that anybody sees or walks on. A cell
    beside an obstacle may fall to either side.
    """
    piece = np.asarray(label(free, connectivity=1))
    largest = int(np.argmax(np.bincount(piece[free])))
    return ndimage.binary_erosion(piece == largest)


def score(scene: TrueScene, bundle: SceneBundle, seed_rng: np.random.Generator) -> Score:
    """Compare a bundle with the exact building; both in the same world."""
    plan = scene.plan
    floor, free = bundle.floor(0), bundle.freemap(0)
    fine, mask = true_floor(plan)
    rows, columns = np.nonzero(mask)
    xy = fine.center_of(np.stack([rows, columns], -1))
    cells = floor.grid.cell_of(xy)
    inside = floor.grid.inside(cells)
    cells = cells[inside]
    covered = floor.covered[cells[:, 0], cells[:, 1]]
    error = np.abs(floor.height_m[cells[:, 0], cells[:, 1]] - plan.floor_z_m)[covered]
    corners = scene.shape.corners
    blocked = obstacle_cells(free.grid, corners)
    rows, columns = np.nonzero(np.ones(free.grid.shape, dtype=bool))
    at = fine.cell_of(free.grid.center_of(np.stack([rows, columns], -1)))
    on = fine.inside(at)
    true = np.zeros(len(at), dtype=bool)
    true[on] = mask[at[on, 0], at[on, 1]]
    open_ = reachable(true.reshape(free.grid.shape) & ~blocked)
    doors = [o for o in plan.openings if o.kind in ("door", "passage") and o.room < o.other_room]
    closed = sum(_closed(free.traversable, free.grid, plan, door) for door in doors)
    missed, things = _missed(scene, free.traversable, free.grid)
    return Score(
        1e3 * float(np.median(error)),
        1e3 * float(np.quantile(error, 0.95)),
        1e3 * _wall_error(scene, bundle, seed_rng),
        100 * float(free.traversable[open_].mean()),
        len(doors),
        closed,
        things,
        missed,
        "unsound" not in bundle.source,
    )


def _closed(traversable: Mask, grid: GridSpec, plan: object, door: object) -> bool:
    """Return whether no free cells lead through a doorway."""
    place = wall_frame(plan.rooms[door.room], door.axis, door.sign)  # type: ignore[attr-defined]
    width, wall = door.end_m - door.start_m, plan.wall_m  # type: ignore[attr-defined]
    along = door.start_m + np.linspace(0.1, 0.9, 25) * width  # type: ignore[attr-defined]
    across = np.linspace(-0.35, wall + 0.35, 40)
    xy = np.array([[place(a, b, 0)[:2] for b in across] for a in along])
    cells = grid.cell_of(xy.reshape(-1, 2))
    free = traversable[cells[:, 0], cells[:, 1]].reshape(len(along), len(across))
    part = np.asarray(label(free, connectivity=1))
    return not (set(part[:, 0]) & set(part[:, -1]) - {0})


def _missed(scene: TrueScene, traversable: Mask, grid: GridSpec) -> tuple[tuple[str, ...], int]:
    """Return the things of which most of the floor plan is free, and how many things there are."""
    missed, count = [], 0
    for k, thing in enumerate(scene.objects):
        size = np.subtract(thing.upper_m, thing.lower_m)
        tall = min(thing.upper_m[2], HIGH_M) - max(thing.lower_m[2], LOW_M)
        if thing.category in NO_OBSTACLES or min(*size[:2], tall) < THICK_M:
            continue
        cells = obstacle_cells(grid, scene.shape.corners[scene.face_object == k])
        if not cells.any():
            continue
        count += 1
        if traversable[cells].mean() > 0.5:
            missed.append(thing.name)
    return tuple(missed), count


def _wall_error(scene: TrueScene, bundle: SceneBundle, rng: np.random.Generator) -> float:
    """Return the median distance of upright surfaces to the exact wall they show [m]."""
    mesh = bundle.visual()
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    normals, areas = triangle_normals_and_areas(corners)
    upright = np.flatnonzero((np.abs(normals[:, 2]) < 0.3) & (areas > 0))
    face = rng.choice(upright, SAMPLES, p=areas[upright] / areas[upright].sum())
    points = corners[face].mean(1).astype(np.float32)
    tracer = Tracer(scene.shape.corners)
    hits = exact_surface(tracer, points, normals[face].astype(np.float32))
    walls = np.array([o.category == "wall" for o in scene.objects])
    on = (hits.prim >= 0) & walls[scene.face_object[hits.prim]]
    exact = triangle_normals(scene.shape.corners[hits.prim[on]])
    away = points[on] - scene.shape.corners[hits.prim[on], 0]
    return float(np.median(np.abs(np.einsum("ij,ij->i", exact, away))))


def main() -> None:
    """Print one row of a Markdown table for each seed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", type=int, nargs="+")
    parser.add_argument("--keep", type=Path, help="folder for captures and scenes")
    options = parser.parse_args()
    say = sys.stdout.write
    say(HEAD)
    for seed in options.seeds:
        start = time.process_time()
        with tempfile.TemporaryDirectory() as scratch:
            folder = (options.keep or Path(scratch)) / f"apartment-{seed}"
            (folder / "scene").mkdir(parents=True, exist_ok=True)
            if not (folder / "scan.ply").is_file():
                generate_splats(seed, folder)
            bundle = repair_splats(folder / "scan.ply", folder / "scene")
            scene = build_scene(np.random.default_rng(seed), building_config("apartment"))
            s = score(scene, bundle, np.random.default_rng(0))
        say(
            f"| {seed} | {s.floor_mm:.1f} | {s.floor_95_mm:.1f} | {s.wall_mm:.1f} | {s.free:.2f} | "
            f"{s.doors_closed} of {s.doors} | {len(s.missed)} of {s.things} {' '.join(s.missed)} | "
            f"{'yes' if s.sound else 'no'} | {time.process_time() - start:.0f} |\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
