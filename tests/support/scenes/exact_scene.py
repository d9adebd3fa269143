"""A generated building as a repaired scene of its exact geometry, without scan and repair."""

from pathlib import Path

import numpy as np

from tests.support.scenes.homes import exact_freemap
from vlnpe.apartments import TrueScene
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


def write_exact_scene(home: TrueScene, scene_id: str, root: Path) -> SceneBundle:
    """Write `home` into the folder `root` as the scene `scene_id` and open it.

    Every storey is a level with the exact freemap, for sampling and rendering. Nothing can walk
    here: the obstacles are the bounds of the objects, and those of walls and door frames fill
    their doorways. `generate_exact` and the repair make exact scenes to walk in.
    """
    root.mkdir(parents=True, exist_ok=True)
    corners = home.shape.corners.astype(np.float32)
    labels = tuple(sorted({o.category for o in home.objects}))
    label_of = np.array([labels.index(o.category) for o in home.objects])
    visual = VisualMesh(
        vertices=corners.reshape(-1, 3),
        faces=np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3),
        corner_uv=home.shape.uv.astype(np.float32),
        face_material=np.zeros(len(corners), dtype=np.int32),
        face_label=label_of[home.face_object].astype(np.int32),
    )
    objects = [
        LabeledObject(o.name, o.category, o.lower_m, o.upper_m, _level(home, o.upper_m[2]))
        for o in home.objects
    ]
    levels = []
    for k, plan in enumerate(home.storeys):
        freemap = exact_freemap(home, k)
        covered = np.isfinite(freemap.floor_z_m)
        height = np.full(covered.shape, plan.floor_z_m, dtype=np.float32)
        solid = [
            o
            for o in home.objects
            if o.category != "floor"
            and o.upper_m[2] > plan.floor_z_m + 0.05
            and o.lower_m[2] < plan.floor_z_m + 1.9
        ]
        low, high = (np.array([getattr(o, side) for o in solid]) for side in ("lower_m", "upper_m"))
        levels.append(
            (
                Floor(freemap.grid, height, covered),
                Obstacles((low + high) / 2, (high - low) / 2),
                freemap,
            )
        )
        objects += [
            LabeledObject(
                f"Room_{k}_{number}",
                f"room:{room.kind}",
                (*room.lower_m, plan.floor_z_m),
                (*room.upper_m, plan.floor_z_m + plan.ceiling_m),
                k,
            )
            for number, room in enumerate(plan.rooms)
        ]
    save_bundle(
        SceneBundle(
            root=root,
            scene_id=scene_id,
            source={"path": scene_id, "sha256": "0" * 64, "licence": "Apache-2.0"},
            source_to_world=np.eye(4),
            habitat_to_world=np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]),
            materials=(Material("grey"),),
            labels=labels,
            objects=tuple(objects),
            level_floor_z_m=tuple(plan.floor_z_m for plan in home.storeys),
        ),
        visual,
        levels,
    )
    return load_bundle(root)


def _level(home: TrueScene, top_m: float) -> int:
    floors = [plan.floor_z_m for plan in home.storeys]
    return max(k for k, z in enumerate(floors) if top_m > z - 0.1)
