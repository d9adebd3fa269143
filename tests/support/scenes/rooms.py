"""A tiny two-room scene bundle, written straight through the public records.

Two 4 × 4 m rooms (x 0…4 and 4…8, y 0…4), 2.6 m high, joined by a 1 m doorway at y 1.5…2.5 in the
wall x = 4, one box of furniture in each room. Known by heart, so tests can state exact truths.
"""

from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from tests.support.scenes.scans import joined
from vlnpe.formats.scene.bundle import (
    Floor,
    LabeledObject,
    Material,
    Obstacles,
    SceneBundle,
    VisualMesh,
    load_bundle,
    save_bundle,
)
from vlnpe.formats.scene.freemap import Freemap
from vlnpe.formats.scene.grid import GridSpec

WALL = 0.1
# name, category, lower, upper, material
PARTS = [
    ("Wall_south", "wall", (-WALL, -WALL, 0.0), (8 + WALL, 0.0, 2.6), 1),
    ("Wall_north", "wall", (-WALL, 4.0, 0.0), (8 + WALL, 4 + WALL, 2.6), 1),
    ("Wall_west", "wall", (-WALL, 0.0, 0.0), (0.0, 4.0, 2.6), 1),
    ("Wall_east", "wall", (8.0, 0.0, 0.0), (8 + WALL, 4.0, 2.6), 1),
    ("Wall_middle_a", "wall", (4 - WALL / 2, 0.0, 0.0), (4 + WALL / 2, 1.5, 2.6), 1),
    ("Wall_middle_b", "wall", (4 - WALL / 2, 2.5, 0.0), (4 + WALL / 2, 4.0, 2.6), 1),
    ("Table_1", "table", (0.3, 3.0, 0.0), (1.5, 3.7, 0.75), 2),
    ("Sofa_1", "sofa", (6.0, 0.2, 0.0), (7.6, 1.0, 0.8), 3),
]
ROOMS = [
    ("Room_kitchen", "room:kitchen", (0.0, 0.0, 0.0), (4.0, 4.0, 2.6)),
    ("Room_living", "room:living room", (4.0, 0.0, 0.0), (8.0, 4.0, 2.6)),
]


def write_two_rooms(root: Path) -> SceneBundle:
    """Write the bundle into `root` and open it."""
    (root / "textures").mkdir(parents=True, exist_ok=True)
    checker = np.indices((512, 512)).sum(0) // 32 % 2 * 90 + 120
    Image.fromarray(np.stack([checker, checker * 0.8, checker * 0.6], -1).astype(np.uint8)).save(
        root / "textures" / "floor.png"
    )
    materials = (
        Material("floor", (1.0, 1.0, 1.0), "textures/floor.png"),
        Material("wall", (0.85, 0.82, 0.75)),
        Material("wood", (0.55, 0.35, 0.2)),
        Material("fabric", (0.2, 0.3, 0.6)),
    )
    labels = ("floor", "wall", "table", "sofa")
    floor_vertices = np.array([[0, 0, 0], [8, 0, 0], [8, 4, 0], [0, 4, 0]], dtype=float)
    meshes = [(trimesh.Trimesh(floor_vertices, [[0, 1, 2], [0, 2, 3]], process=False), 0, 0)]
    for _, category, lower, upper, material in PARTS:
        box = trimesh.creation.box(bounds=[lower, upper])
        meshes.append((box, material, labels.index(category)))
    merged = joined([m for m, _, _ in meshes])
    faces = np.asarray(merged.faces, dtype=np.int32)
    vertices = np.asarray(merged.vertices, dtype=np.float32)
    counts = [len(m.faces) for m, _, _ in meshes]
    visual = VisualMesh(
        vertices=vertices,
        faces=faces,
        corner_uv=(vertices[faces][..., :2] / 2.0).astype(np.float32),
        face_material=np.repeat([m for _, m, _ in meshes], counts).astype(np.int32),
        face_label=np.repeat([label for _, _, label in meshes], counts).astype(np.int32),
    )
    lower = np.array([p[2] for p in PARTS])
    upper = np.array([p[3] for p in PARTS])
    grid = GridSpec((-0.5, -0.5), 0.05, 100, 180)
    rows, columns = np.indices(grid.shape)
    xy = grid.center_of(np.stack([rows, columns], -1))
    covered = np.all((xy > (0, 0)) & (xy < (8, 4)), axis=-1)
    blocked = np.zeros(grid.shape, dtype=bool)
    for low, high in zip(lower, upper, strict=True):
        blocked |= np.all((xy > low[:2]) & (xy < high[:2]), axis=-1)
    height = np.zeros(grid.shape, dtype=np.float32)
    save_bundle(
        SceneBundle(
            root=root,
            scene_id="two_rooms",
            source={"path": "two_rooms", "sha256": "0" * 64, "licence": "Apache-2.0"},
            source_to_world=np.eye(4),
            habitat_to_world=np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]),
            materials=materials,
            labels=labels,
            objects=tuple(
                [LabeledObject(n, c, lo, hi, 0) for n, c, lo, hi, _ in PARTS]
                + [LabeledObject(n, c, lo, hi, 0) for n, c, lo, hi in ROOMS]
            ),
            level_floor_z_m=(0.0,),
        ),
        visual,
        [
            (
                Floor(grid, height, covered),
                Obstacles((lower + upper) / 2, (upper - lower) / 2),
                Freemap(grid, np.where(covered, height, np.nan), covered & ~blocked),
            )
        ],
    )
    return load_bundle(root)
