"""Six buildings as their exporters would write them, for trials of the repair.

`python -m tests.support.scenes.exporters FOLDER` writes them. Every file is made from what is known
of its exporter: axes, units, names, and which surfaces it leaves out.
"""

import sys
from pathlib import Path

import numpy as np
import trimesh

from tests.support.scenes.scans import TO_Y_UP, box, joined, sheet


def wall(
    start: tuple[float, float], end: tuple[float, float], height: float, thick: float = 0.15,
    *, z: float = 0.0, doors: tuple[float, ...] = (), windows: tuple[float, ...] = (),
) -> list[trimesh.Trimesh]:  # fmt: skip
    """A wall along x or y with doors (0.9 × 2.05 m) and windows (1.2 × 1.3 m) at distances."""
    a, b = np.array(start), np.array(end)
    length = float(np.linalg.norm(b - a))
    along = (b - a) / length
    side = np.array([-along[1], along[0]]) * thick / 2

    def piece(first: float, last: float, low: float, high: float) -> list[trimesh.Trimesh]:
        if last - first < 1e-6 or high - low < 1e-6:
            return []
        corners = np.array([a + along * first - side, a + along * last + side])
        return [box((*corners.min(0), z + low), (*corners.max(0), z + high))]

    parts, at = [], 0.0
    gaps = sorted([(d, 0.9, 0.0, 2.05) for d in doors] + [(w, 1.2, 0.9, 2.2) for w in windows])
    for place, width, low, high in gaps:
        parts += piece(at, place, 0, height) + piece(place, place + width, 0, low)
        parts += piece(place, place + width, high, height)
        at = place + width
    return parts + piece(at, length, 0, height)


def dae_through_assimp(folder: Path) -> Path:
    """A simulator's office: z up in a glTF, one mesh per material, no ceiling."""
    walls = [
        *wall((0, 0), (18, 0), 2.8, windows=(2, 6, 10, 14)),
        *wall((0, 11), (18, 11), 2.8, windows=(2, 6, 10, 14)),
        *wall((0, 0), (0, 11), 2.8, doors=(5,)),
        *wall((18, 0), (18, 11), 2.8),
        *wall((0, 4.5), (18, 4.5), 2.8, doors=(2, 8, 14)),
        *wall((0, 6.5), (18, 6.5), 2.8, doors=(3, 9, 15)),
        *[w for x in (6, 12) for w in wall((x, 0), (x, 4.5), 2.8)],
        *[w for x in (7, 13) for w in wall((x, 6.5), (x, 11), 2.8)],
    ]
    desks = [box((x, y, 0.72), (x + 1.6, y + 0.8, 0.75)) for x in (1, 8, 14) for y in (1, 9.5)]
    desks += [box((x, y, 0), (x + 0.05, y + 0.8, 0.72)) for x in (1, 8, 14) for y in (1, 9.5)]
    scene = trimesh.Scene()
    floor = sheet((0, 0), (18, 11), step=18)
    for k, part in enumerate((joined(walls), floor, joined(desks))):
        part.unmerge_vertices()
        scene.add_geometry(part, node_name=f"mesh{k}-0", geom_name=f"mesh{k}")
    path = folder / "office_assimp.glb"
    scene.export(str(path))
    own = b"https://github.com/mikedh/trimesh"
    path.write_bytes(
        path.read_bytes().replace(own, b"Open Asset Import Library (assimp".ljust(len(own)))
    )
    return path


def room_plan(folder: Path) -> Path:
    """A headset's parametric room: y up, boxes, turned, at the height of the phone, no floor."""
    from pxr import Gf, Usd, UsdGeom, UsdUtils

    stage = Usd.Stage.CreateNew(str(folder / "Room.usda"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/Room").GetPrim())
    turn = np.deg2rad(23.0)
    parts: dict[str, list[trimesh.Trimesh]] = {
        "Walls/Wall0": wall((0, 0), (5.2, 0), 2.5, 0.02),
        "Walls/Wall1": wall((5.2, 0), (5.2, 4.1), 2.5, 0.02, doors=(1.2,)),
        "Walls/Wall2": wall((0, 4.1), (5.2, 4.1), 2.5, 0.02, windows=(2.0,)),
        "Walls/Wall3": wall((0, 0), (0, 4.1), 2.5, 0.02),
        "Doors/Door0": [box((5.18, 1.2, 0), (5.22, 2.1, 2.05))],
        "Windows/Window0": [box((2.0, 4.08, 0.9), (3.2, 4.12, 2.2))],
        "Objects/Table0": [box((2, 1.5, 0), (3.6, 2.4, 0.74))],
        "Objects/Chair0": [box((2.2, 1.0, 0), (2.7, 1.5, 0.9))],
        "Objects/Sofa0": [box((0.1, 2.2, 0), (1.0, 4.0, 0.8))],
        "Objects/Storage0": [box((0.1, 0.1, 0), (1.3, 0.5, 1.9))],
    }
    for name, pieces in parts.items():
        mesh = joined(pieces)
        points = mesh.vertices @ np.array(
            [[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
        )
        points = points[:, [0, 2, 1]] * (1, 1, -1) + (-2.1, -1.38, 1.7)
        prim = UsdGeom.Mesh.Define(stage, f"/Room/{name}")
        prim.CreatePointsAttr([Gf.Vec3f(*map(float, p)) for p in points])
        prim.CreateFaceVertexCountsAttr([3] * len(mesh.faces))
        prim.CreateFaceVertexIndicesAttr(mesh.faces.ravel().tolist())
    stage.Save()
    path = folder / "Room.usdz"
    path.unlink(missing_ok=True)
    UsdUtils.CreateNewUsdzPackage(str(folder / "Room.usda"), str(path))
    return path


def revit(folder: Path) -> Path:
    """A two-storey house in feet at state-plane coordinates, z up, with its topography."""
    parts: dict[str, list[trimesh.Trimesh]] = {}
    hole_low, hole_high = (9.0, 1.0), (10.1, 5.4)
    for level, z in enumerate((0.0, 3.0)):
        parts[f"Walls_Basic_Wall_Exterior_{1000 + level}"] = [
            *wall((0, 0), (12, 0), 2.7, 0.3, z=z, windows=(2, 8), doors=(5,) if not level else ()),
            *wall((0, 8), (12, 8), 2.7, 0.3, z=z, windows=(2, 5, 8)),
            *wall((0, 0), (0, 8), 2.7, 0.3, z=z, windows=(3,)),
            *wall((12, 0), (12, 8), 2.7, 0.3, z=z),
        ]
        parts[f"Walls_Basic_Wall_Interior_{2000 + level}"] = wall(
            (6, 0.15), (6, 7.85), 2.7, 0.12, z=z, doors=(3,)
        )
        inside = [(0.0, 0.0, 12.0, 8.0)]
        if level:
            (x0, y0), (x1, y1) = hole_low, hole_high
            inside = [(0, 0, x0, 8), (x1, 0, 12, 8), (x0, 0, x1, y0), (x0, y1, x1, 8)]
        parts[f"Floors_Floor_Generic_12in_{3000 + level}"] = [
            box((a, b, z - 0.3), (c, d, z)) for a, b, c, d in inside
        ]
    parts["Stairs_Assembled_4000"] = [
        box((9.0, 1.0 + 0.27 * k, 0.1875 * k), (10.1, 1.27 + 0.27 * k, 0.1875 * (k + 1)))
        for k in range(16)
    ]
    parts["Roofs_Basic_Roof_5000"] = [box((-0.6, -0.6, 5.7), (12.6, 8.6, 6.0))]
    parts["Furniture_Sofa_6000"] = [box((1, 5.5, 0), (3.2, 6.4, 0.8))]
    parts["Furniture_Desk_6001"] = [box((7, 6.5, 3.0), (8.6, 7.3, 3.75))]
    ground = sheet((-60, -50), (75, 60), z=-0.45, step=5.0)
    points = np.array(ground.vertices)
    points[:, 2] += 0.03 * np.maximum(np.abs(points[:, 0]) - 20, 0)
    ground.vertices = points
    parts["Topography_Surface_7000"] = [ground]
    scene = trimesh.Scene()
    for name, pieces in parts.items():
        mesh = joined(pieces)
        mesh.apply_scale(1 / 0.3048)
        mesh.apply_translation((1_284_512.0, 687_344.0, 412.0))
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    path = folder / "house_revit.obj"
    scene.export(str(path))
    return path


def game_level(folder: Path) -> Path:
    """A level of modules with a ramp, a roofless yard, water, ground and a sky dome; y up."""
    modules = []
    for i in range(6):
        for j in range(4):
            z = 0.0 if i < 4 else 1.2
            modules.append(
                (f"floor_4x4_{i}{j}", box((4 * i, 4 * j, z - 0.2), (4 * i + 4, 4 * j + 4, z)))
            )
    walls = [
        *wall((0, 0), (24, 0), 4.0, 0.4, doors=(2,)),
        *wall((0, 16), (24, 16), 4.0, 0.4),
        *wall((0, 0), (0, 16), 4.0, 0.4),
        *wall((24, 0), (24, 16), 4.0, 0.4),
        *wall((8, 0), (8, 16), 4.0, 0.4, doors=(6,)),
        *wall((16, 0), (16, 8), 4.0, 0.4),
    ]
    ramp = box((12, 10, -0.2), (16, 12, 0.0))
    points = np.array(ramp.vertices)
    points[:, 2] += np.where(points[:, 0] > 14, 1.2, 0.0)
    ramp.vertices = points
    dome = trimesh.creation.icosphere(subdivisions=3, radius=600)
    dome.update_faces(dome.triangles_center[:, 2] > -40)
    scene = trimesh.Scene()
    everything = {
        **dict(modules),
        **{f"wall_{k}": w for k, w in enumerate(walls)},
        "ramp_a": ramp,
        "ceiling": box((8, 0, 4), (24, 16, 4.3)),
        "crate_1": box((2, 2, 0), (3, 3, 1)), "crate_2": box((10, 13, 0), (11, 14, 1)),
        "SM_SkyDome": dome,
        "Landscape": sheet((-300, -300), (320, 310), z=-0.35, step=20),
        "water_plane": sheet((-500, -500), (500, 500), z=-3.0, step=1000),
    }  # fmt: skip
    for name, part in everything.items():
        mesh = part.copy()
        mesh.apply_transform(TO_Y_UP)
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    path = folder / "level_sky.glb"
    scene.export(str(path))
    own = b"https://github.com/mikedh/trimesh"
    path.write_bytes(
        path.read_bytes().replace(own, b"Khronos glTF Blender I/O v4.2.57".ljust(len(own)))
    )
    return path


def ifc_shell(folder: Path) -> Path:
    """A bare two-storey shell through IfcConvert: z up in a glTF, names are identifiers."""
    pieces = []
    for z in (0.0, 3.1):
        pieces += wall((0, 0), (10, 0), 2.8, 0.3, z=z, windows=(1.5, 6.5), doors=() if z else (4,))
        pieces += wall((0, 7), (10, 7), 2.8, 0.3, z=z, windows=(2, 5))
        pieces += wall((0, 0), (0, 7), 2.8, 0.3, z=z)
        pieces += wall((10, 0), (10, 7), 2.8, 0.3, z=z)
        pieces += wall((4, 0.15), (4, 6.85), 2.8, 0.12, z=z, doors=(2.5,))
    pieces += [box((-0.15, -0.15, -0.3), (10.15, 7.15, 0.0))]
    pieces += [
        box((-0.15, -0.15, 2.8), (7.0, 7.15, 3.1)), box((8.2, -0.15, 2.8), (10.15, 7.15, 3.1)),
        box((7.0, -0.15, 2.8), (8.2, 1.0, 3.1)), box((7.0, 5.2, 2.8), (8.2, 7.15, 3.1)),
    ]  # fmt: skip
    pieces += [
        box((7.0, 1.0 + 0.26 * k, 0.19 * k), (8.2, 1.26 + 0.26 * k, 0.19 * (k + 1)))
        for k in range(16)
    ]
    pieces += [box((-0.5, -0.5, 5.9), (10.5, 7.5, 6.2))]
    rng = np.random.default_rng(0)
    letters = np.array(list("0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz_$"))
    scene = trimesh.Scene()
    for piece in pieces:
        name = "".join(rng.choice(letters, 22))
        scene.add_geometry(piece, node_name=name, geom_name=name)
    path = folder / "shell_ifc.glb"
    scene.export(str(path))
    own = b"https://github.com/mikedh/trimesh"
    path.write_bytes(
        path.read_bytes().replace(own, b"IfcOpenShell IfcConvert 0.8.0".ljust(len(own)))
    )
    return path


def church(folder: Path) -> Path:
    """A church with a gallery over the entrance, thick walls and a pitched roof: STL in mm."""
    pieces = [
        sheet((0, 0), (26, 12), step=2.0),
        *wall((0, 0), (26, 0), 9.0, 1.0, windows=(4, 8, 12, 16, 20)),
        *wall((0, 12), (26, 12), 9.0, 1.0, windows=(4, 8, 12, 16, 20)),
        *wall((0, 0), (0, 12), 9.0, 1.0, doors=(5.5,)),
        *wall((26, 0), (26, 12), 9.0, 1.0),
    ]
    for x in (6, 11, 16, 21):
        for y in (3, 9):
            pieces.append(trimesh.creation.cylinder(0.4, segment=[(x, y, 0), (x, y, 9)]))
    for k in range(8):
        pieces.append(
            box(
                (14 + 1.2 * (k % 4), 4 if k < 4 else 6.8, 0),
                (14.5 + 1.2 * (k % 4), 5.6 if k < 4 else 8.4, 0.5),
            )
        )
    pieces.append(box((23.5, 4.5, 0), (25, 7.5, 0.2)))
    pieces.append(box((24, 5.3, 0.2), (24.8, 6.7, 1.2)))
    # The gallery: a slab on two posts with a balustrade, reached by a straight flight.
    pieces += [box((0.5, 0.5, 3.8), (4.5, 10.3, 4.0)), box((4.4, 0.5, 4.0), (4.5, 11.5, 5.0))]
    pieces += [box((0.5, 10.3, 3.8), (1.3, 11.5, 4.0))]
    pieces += [
        box((1.3 + 0.2 * k, 10.3, 0.0), (1.5 + 0.2 * k, 11.5, 0.2 * (20 - k))) for k in range(20)
    ]
    ridge = np.array(
        [[0, 0, 9], [26, 0, 9], [26, 6, 14], [0, 6, 14], [0, 12, 9], [26, 12, 9]], float
    )
    pieces.append(
        trimesh.Trimesh(ridge, [[0, 1, 2], [0, 2, 3], [4, 3, 2], [4, 2, 5]], process=False)
    )
    pieces.append(trimesh.Trimesh(ridge, [[0, 3, 4], [1, 5, 2]], process=False))
    mesh = joined(pieces)
    mesh.apply_scale(1000.0)
    path = folder / "church.stl"
    mesh.export(str(path))
    return path


ALL = (dae_through_assimp, room_plan, revit, game_level, ifc_shell, church)

if __name__ == "__main__":
    target = Path(sys.argv[1])
    target.mkdir(parents=True, exist_ok=True)
    for write in ALL:
        sys.stdout.write(f"{write(target)}\n")
