"""Made-up buildings with more than one height of floor, or with things that look like floors.

World coordinates: z up, metres. Every function gives the building's parts.
"""

import numpy as np
import trimesh

from . import scans

Parts = list[trimesh.Trimesh]


def two_storeys(roof: bool = True) -> Parts:
    """5 × 4 m twice, floors at 0 and 2.8 m, a stairwell of 1 × 2.5 m between; a flat roof."""
    gap = scans.rectangle((1.0, 1.0), (2.0, 3.5))
    steps = [
        scans.box((1.0, 1.0 + 0.25 * k, 0.0), (2.0, 1.25 + 0.25 * k, 0.25 * (10 - k)))
        for k in range(10)
    ]
    upper = [w.apply_translation((0, 0, 2.8)) for w in scans.walls((0, 0), (5, 4), 2.5)]
    parts = [
        scans.sheet((0, 0), (5, 4)),
        *scans.walls((0, 0), (5, 4), 2.5),
        scans.sheet((0, 0), (5, 4), z=2.5, without=gap, facing_up=False),
        scans.sheet((0, 0), (5, 4), z=2.8, without=gap),
        *upper,
        *steps,
    ]
    if roof:
        parts += [
            scans.sheet((0, 0), (5, 4), z=5.3, facing_up=False),
            scans.sheet((-0.5, -0.5), (5.5, 4.5), z=5.5),
        ]
    return parts


def split_level(step_m: float = 0.4) -> Parts:
    """A room of 4 × 4 m at 0 and one of 3 × 4 m higher, joined along their whole side."""
    riser = trimesh.Trimesh(
        [[4, 0, 0], [4, 4, 0], [4, 4, step_m], [4, 0, step_m]],
        [[0, 2, 1], [0, 3, 2]],
        process=False,
    )
    return [
        scans.sheet((0, 0), (4, 4)),
        scans.sheet((4, 0), (7, 4), z=step_m),
        riser,
        *scans.walls((0, 0), (7, 4)),
        scans.sheet((0, 0), (7, 4), z=2.6, step=0.5, facing_up=False),
    ]


def ramp(rise_m: float = 0.25, without: scans.Inside | None = None) -> Parts:
    """Level floor (x 0 … 3), a ramp 1:12 (x 3 … 3 + 12 × rise), level floor (3 m more)."""
    foot, head = 3.0, 3.0 + 12 * rise_m
    size = (head + 3.0, 3.0)
    floor = scans.sheet((0, 0), size, without=without)
    vertices = np.array(floor.vertices)
    vertices[:, 2] = np.clip((vertices[:, 0] - foot) / 12, 0.0, rise_m)
    floor.vertices = vertices
    return [
        floor,
        *scans.walls((0, 0), size),
        scans.sheet((0, 0), size, z=2.6, step=0.5, facing_up=False),
    ]


def sunken(depth_m: float = 0.3, without: scans.Inside | None = None) -> Parts:
    """A room of 6 × 5 m with an area of 2.5 × 2.5 m that lies lower."""
    pit = scans.rectangle((2.0, 1.5), (4.5, 4.0))
    sides = trimesh.creation.box(bounds=[(2.0, 1.5, -depth_m), (4.5, 4.0, 0.0)])
    upright = np.abs(sides.face_normals[:, 2]) < 0.5
    sides.update_faces(upright)
    sides.invert()
    bottom = scans.sheet((2.0, 1.5), (4.5, 4.0), z=-depth_m, without=without)
    return [
        scans.sheet((0, 0), (6, 5), without=pit),
        bottom,
        sides,
        *scans.walls((0, 0), (6, 5)),
        scans.sheet((0, 0), (6, 5), z=2.6, step=0.5, facing_up=False),
    ]


def mezzanine() -> Parts:
    """A hall of 6 × 4 × 5 m with a gallery of 2 × 4 m at 2.5 m, which has a rail."""
    return [
        scans.sheet((0, 0), (6, 4)),
        *scans.walls((0, 0), (6, 4), 5.0),
        scans.sheet((0, 0), (6, 4), z=5.0, step=0.5, facing_up=False),
        scans.sheet((0, 0), (2, 4), z=2.5),
        scans.sheet((0, 0), (2, 4), z=2.3, facing_up=False),
        scans.box((1.95, 0.0, 2.3), (2.0, 4.0, 3.4)),
    ]


def furnished() -> Parts:
    """A room of 6 × 5 m with a bed, a long table, a counter and a low stage-like sofa."""
    return [
        *scans.room(size=(6.0, 5.0)),
        scans.box((0.0, 1.0, 0.25), (2.1, 3.0, 0.55)),
        scans.box((2.6, 3.6, 0.72), (5.4, 4.7, 0.75)),
        *[
            scans.box((x, y, 0.0), (x + 0.05, y + 0.05, 0.72))
            for x in (2.65, 5.3)
            for y in (3.65, 4.6)
        ],
        scans.box((2.8, 0.0, 0.001), (6.0, 0.7, 0.9)),
        scans.box((3.2, 1.6, 0.001), (5.4, 2.6, 0.42)),
    ]


def under_a_roof(pitch_deg: float, shed: bool = False) -> Parts:
    """A room of 8 × 6 m with a flat ceiling, under a gable roof, or a shed roof, that juts out.

    The roof is a solid of 20 cm; the gable walls reach up to it.
    """
    rise = np.tan(np.deg2rad(pitch_deg))
    lower, upper = np.array([-0.6, -0.6]), np.array([8.6, 6.6])

    def roof(z: float, facing_up: bool) -> trimesh.Trimesh:
        sheet = scans.sheet(lower, upper, z=z, step=0.2, facing_up=facing_up)
        points = np.array(sheet.vertices)
        run = points[:, 1] + 0.6 if shed else 3.6 - np.abs(points[:, 1] - 3.0)
        points[:, 2] += rise * run
        sheet.vertices = points
        return sheet

    def gable(x: float) -> trimesh.Trimesh:
        top = [(6.0, 2.7 + 6.6 * rise)] if shed else [(3.0, 2.7 + 3.6 * rise)]
        points = [(x, y, z) for y, z in [(0.0, 2.6), (6.0, 2.6), *top]]
        return trimesh.Trimesh(points, [[0, 1, 2]], process=False)

    return [
        *scans.room(size=(8.0, 6.0)),
        scans.sheet((0, 0), (8, 6), z=2.7, step=0.5),
        roof(2.7, facing_up=False),
        roof(2.9, facing_up=True),
        gable(0.0),
        gable(8.0),
    ]


def in_one_plane(slab_m: float = 0.0, storey_m: float = 2.8, turn_deg: float = 0.0) -> Parts:
    """Two storeys whose lower ceiling lies in the plane of the upper floor, or `slab_m` below it.

    As exporters stack storeys: the ceiling runs on across the stairwell of 1 × 2.5 m. With a
    negative slab the ceiling lies above the floor.
    """
    gap = scans.rectangle((1.0, 1.0), (2.0, 3.5))
    tread_m = (storey_m - 0.2) / 10
    steps = [
        scans.box((1.0, 1.0 + 0.25 * k, 0.0), (2.0, 1.25 + 0.25 * k, tread_m * (10 - k)))
        for k in range(10)
    ]
    upper = [w.apply_translation((0, 0, storey_m)) for w in scans.walls((0, 0), (5, 4), 2.6)]
    parts = [
        scans.sheet((0, 0), (5, 4)),
        *scans.walls((0, 0), (5, 4), storey_m - 0.2),
        scans.sheet((0, 0), (5, 4), z=storey_m - slab_m, facing_up=False),
        scans.sheet((0, 0), (5, 4), z=storey_m, without=gap),
        *upper,
        *steps,
        scans.sheet((0, 0), (5, 4), z=storey_m + 2.6, facing_up=False),
    ]
    turn = trimesh.transformations.rotation_matrix(np.deg2rad(turn_deg), (0, 0, 1))
    return [part.apply_transform(turn) for part in parts]


def tower_in_one_plane() -> Parts:
    """Three storeys of 5 × 4 m, each but the last with a ceiling in the plane of the floor above.

    Stairwells of 1 × 2.5 m, over which the ceilings run on, lie at alternate places.
    """
    storey_m = 2.8
    parts = [scans.sheet((0, 0), (5, 4))]
    for k, x in enumerate((1.0, 3.0)):
        low, z = storey_m * k, storey_m * (k + 1)
        gap = scans.rectangle((x, 1.0), (x + 1.0, 3.5))
        parts += [
            scans.sheet((0, 0), (5, 4), z=z, facing_up=False),
            scans.sheet((0, 0), (5, 4), z=z, without=gap),
        ]
        parts += [
            scans.box((x, 1.0 + 0.25 * n, low), (x + 1.0, 1.25 + 0.25 * n, low + 0.26 * (10 - n)))
            for n in range(10)
        ]
    for k in range(3):
        walls = scans.walls((0, 0), (5, 4), storey_m - 0.2)
        parts += [wall.apply_translation((0, 0, storey_m * k)) for wall in walls]
    return [*parts, scans.sheet((0, 0), (5, 4), z=3 * storey_m - 0.2, facing_up=False)]


def lift_shaft() -> Parts:
    """A room of 6 × 5 m with a walled shaft of 1.6 × 1.6 m in it, without bottom or door."""
    shaft = scans.rectangle((3.0, 3.0), (4.6, 4.6))
    return [
        *scans.room(size=(6.0, 5.0), without=shaft),
        *scans.walls((3.0, 3.0), (4.6, 4.6), 2.6),
    ]
