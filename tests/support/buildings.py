"""Made-up buildings with more than one height of floor, or with things that look like floors.

World coordinates: z up, metres. Every function gives the building's parts.
"""

from __future__ import annotations

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
