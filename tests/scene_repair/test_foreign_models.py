"""Models as converters, games, surveys and simulators leave them: right, or with a word."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from tests.support.scenes import buildings, repairs, scans
from tests.support.scenes.foreign import FAR, Parts, box, room, shell, write, write_usd
from vlnpe.formats.core.errors import SceneError, UnknownNameError
from vlnpe.formats.scene.bundle import SceneBundle, load_bundle
from vlnpe.pipeline.cli import main
from vlnpe.scene_repair.config import RepairConfig
from vlnpe.scene_repair.orient.transform import orient
from vlnpe.scene_repair.scan.dispatch import read_scan
from vlnpe.scene_repair.scan.left_out import without_parts

pytestmark = pytest.mark.chain


def repaired(source: Path, **options: Any) -> tuple[SceneBundle, dict[str, Any]]:
    bundle = repairs.repaired(source, source.parent, picture_px=64, **options)
    return bundle, json.loads((bundle.root / "repair.json").read_text())


def area(record: dict[str, Any], level: int = 0) -> float:
    return record["levels"][level]["floor_area_before_m2"]


# On its side ------------------------------------------------------------------------------------

CONVERTERS = ["Open Asset Import Library (assimp", "IfcOpenShell IfcConvert 0.8", "obj2gltf", ""]


@pytest.mark.parametrize("generator", CONVERTERS)
@pytest.mark.parametrize("name", ["bare", "with a floor", "walls of a church"])
def test_z_up_in_a_y_up_format_is_noticed(name: str, generator: str, tmp_path: Path) -> None:
    parts = {
        "bare": shell(),
        "with a floor": [*shell(), scans.sheet((0, 0), (12, 9), step=1.0)],
        "walls of a church": shell(30.0, 14.0, 0.9),
    }[name]
    evidence = orient(
        read_scan(write(parts, tmp_path / "a.glb", generator=generator)), RepairConfig()
    ).evidence
    assert evidence["up"] == "z"
    assert any("--up y" in doubt for doubt in evidence["doubts"])


def test_an_editors_word_about_up_is_doubted_rather_than_overruled(tmp_path: Path) -> None:
    source = write(shell(), tmp_path / "a.glb", generator="Khronos glTF Blender I/O v4.2")
    evidence = orient(read_scan(source), RepairConfig()).evidence
    assert evidence["up"] == "z" or any("--up z" in doubt for doubt in evidence["doubts"])


@pytest.mark.parametrize("generator", [*CONVERTERS, "Khronos glTF Blender I/O v4.2"])
@pytest.mark.parametrize(
    "name", ["bare", "room", "two storeys", "gable roof", "three storeys", "mezzanine"]
)
def test_y_up_stays_up(name: str, generator: str, tmp_path: Path) -> None:
    parts = {
        "bare": shell(),
        "room": list(room().values()),
        "two storeys": buildings.two_storeys(),
        "gable roof": buildings.under_a_roof(30),
        "three storeys": buildings.tower_in_one_plane(),
        "mezzanine": buildings.mezzanine(),
    }[name]
    scan = read_scan(write(parts, tmp_path / "a.glb", y_up=True, generator=generator))
    evidence = orient(scan, RepairConfig()).evidence
    assert (evidence["up"], evidence["doubts"]) == ("y", [])


@pytest.mark.parametrize("closed", [False, True], ids=["walls alone", "floor and ceiling"])
def test_an_empty_building_says_that_either_end_may_be_up(closed: bool, tmp_path: Path) -> None:
    # More heads of doors and windows than sills, all in the upper half.
    heads = [box((x, 8.8, 2.1), (x + 1, 9, 2.2)) for x in range(1, 11, 2)]
    slabs = [box((0, 0, -0.2), (12, 9, 0)), box((0, 0, 3), (12, 9, 3.2))]
    parts = [*shell(), *heads, *slabs] if closed else shell()
    scan = read_scan(write(parts, tmp_path / "a.obj"))
    evidence = orient(scan, RepairConfig()).evidence
    assert evidence["up"] == "z"
    assert any("which end" in doubt and "--up" in doubt for doubt in evidence["doubts"])


# No floor ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("thick", [0.2, 0.5, 1.1])
def test_undersides_of_walls_are_no_floor(thick: float, tmp_path: Path) -> None:
    source = write(shell(16, 12, thick), tmp_path / "a.glb", y_up=True)
    with pytest.raises(SceneError) as caught:
        repaired(source)
    text = str(caught.value)
    assert "--floor 0.00" in text
    assert "inside of a wall" in text
    assert "walls only under it" in text  # of their upper sides


def test_a_floor_is_laid_inside_the_walls(tmp_path: Path) -> None:
    source = write(shell(), tmp_path / "a.glb", y_up=True, shift=(0, 0, 1.5))
    bundle, record = repaired(source, floor_m=1.5)
    assert bundle.level_floor_z_m == pytest.approx((1.5,), abs=0.01)
    assert area(record) == pytest.approx(12 * 9, rel=0.03)
    assert any("--floor" in line and "1.50 m" in line for line in record["warnings"])
    freemap = bundle.freemap(0)
    assert freemap.traversable.sum() * freemap.grid.cell_m**2 > 85
    assert record["verification"]["sound"]


def test_a_ceiling_is_laid_inside_the_walls(tmp_path: Path) -> None:
    source = write(shell(), tmp_path / "a.glb", y_up=True)
    bundle, record = repaired(source, floor_m=0.0, ceiling_m=2.7)
    assert any("--ceiling" in line and "2.70 m" in line for line in record["warnings"])
    mesh = bundle.visual()
    corners = mesh.vertices[mesh.faces]
    flat = np.isclose(corners[..., 2], 2.7, atol=1e-3).all(axis=1)
    sides = np.diff(corners[flat], axis=1)
    covered = np.abs(np.cross(sides[:, 0], sides[:, 1])[:, 2]).sum() / 2
    assert 12 * 9 <= covered < 1.2 * 12 * 9
    assert area(record) == pytest.approx(12 * 9, rel=0.03) and len(record["levels"]) == 1


@pytest.mark.parametrize(
    ("laid", "reason"),
    [
        ({"floor_m": 9.0}, r"--floor 9: .* a place 0\.\d+ to \d\.\d+ m above it; .* walls begin"),
        ({"ceiling_m": 9.0}, r"--ceiling 9: .* a place 0\.1 to 0\.5 m below it; .* walls end"),
    ],
)
def test_nothing_is_laid_where_no_walls_are(
    laid: dict[str, float], reason: str, tmp_path: Path
) -> None:
    source = write(shell(), tmp_path / "a.glb", y_up=True)
    with pytest.raises(SceneError, match=reason):
        repaired(source, **laid)


@pytest.mark.parametrize("sheet", ["floor", "ceiling"])
def test_a_floor_or_ceiling_where_no_walls_are_is_refused(sheet: str, tmp_path: Path) -> None:
    source = write(shell(), tmp_path / "a.glb", y_up=True)
    with pytest.raises(SceneError, match=f"--{sheet} 50"):
        repaired(source, **{f"{sheet}_m": 50.0})


@pytest.mark.parametrize("slab_m", [0.05, 0.085, 0.0999, 0.1, 0.15])
def test_the_underside_of_a_slab_is_no_floor(slab_m: float, tmp_path: Path) -> None:
    parts = {**room(), "floor": box((-3, -2.5, -slab_m), (3, 2.5, 0))}
    bundle, record = repaired(write(parts, tmp_path / "a.glb", y_up=True, shift=(0, 0, 7.3)))
    assert bundle.level_floor_z_m == pytest.approx((7.3,), abs=0.005)
    assert area(record) == pytest.approx(30.0, rel=0.01)


# Roofs ------------------------------------------------------------------------------------------


def lantern() -> list[trimesh.Trimesh]:
    """A gallery whose ceiling has an opening with a glass lantern on it, and a low parapet."""
    glass = [(x * s, y * s, z) for s, z in ((3.5, 2.95), (1.5, 5.0))
             for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]  # fmt: skip
    faces = [[0, 1, 5], [0, 5, 4], [1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4],
             [3, 4, 7], [4, 5, 6], [4, 6, 7]]  # fmt: skip
    walls = scans.walls((-5, -5), (5, 5), 3.05)
    ring = scans.sheet((-5, -5), (5, 5), z=2.95, step=0.5,
                       without=scans.rectangle((-3.5, -3.5), (3.5, 3.5)))  # fmt: skip
    under = scans.sheet((-5, -5), (5, 5), z=2.9, step=0.5, facing_up=False,
                        without=scans.rectangle((-3.5, -3.5), (3.5, 3.5)))  # fmt: skip
    return [scans.sheet((-5, -5), (5, 5)), *walls, ring, under, trimesh.Trimesh(glass, faces)]


def flat_roof(parapet_m: float, stairs: bool = False) -> list[trimesh.Trimesh]:
    """A house with a flat roof that one may stand on; its walls end in a parapet."""
    gap = scans.rectangle((1.0, 1.0), (2.0, 3.5)) if stairs else None
    steps = [
        box((1.0, 1.0 + 0.25 * k, 0.0), (2.0, 1.25 + 0.25 * k, 0.28 * (10 - k))) for k in range(10)
    ]
    return [
        scans.sheet((0, 0), (6, 5)),
        *scans.walls((0, 0), (6, 5), 2.8 + parapet_m),
        scans.sheet((0, 0), (6, 5), z=2.6, without=gap, facing_up=False),
        scans.sheet((0, 0), (6, 5), z=2.8, without=gap),
        *(steps if stairs else []),
    ]


ROOFS = {
    "lantern": (lantern(), (0.0,)),
    "parapet": (flat_roof(1.0), (0.0,)),
    "terrace with stairs": (flat_roof(1.0, stairs=True), (0.0, 2.8)),
    "storey without a ceiling": (flat_roof(2.5), (0.0, 2.8)),
    "glass box": (
        [*room().values(), box((-1, -1, 2.7), (1, 1, 4)), box((-1.2, -1.2, 4), (1.2, 1.2, 4.1))],
        (0.0,),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ROOFS)
def test_what_no_stairs_lead_to_under_the_open_sky_is_a_roof(name: str, tmp_path: Path) -> None:
    parts, heights = ROOFS[name]
    bundle, record = repaired(write(parts, tmp_path / "a.glb", y_up=True))
    assert bundle.level_floor_z_m == pytest.approx(heights, abs=0.02)
    if name in ("lantern", "parapet"):
        assert any("--allow-roof" in doubt for doubt in record["doubts"])


def test_a_roof_is_a_level_if_the_user_says_so(tmp_path: Path) -> None:
    bundle, record = repaired(write(flat_roof(1.0), tmp_path / "a.glb", y_up=True), allow_roof=True)
    assert len(bundle.level_floor_z_m) == 2
    assert not any("roof" in doubt for doubt in record["doubts"])


def test_every_surface_gets_its_own_reason(tmp_path: Path) -> None:
    """Walls, a pitched roof and a table without a floor: nothing to stand on, for three reasons."""
    roof = scans.sheet((0, 0), (12, 9), z=3.0, step=0.25)
    points = np.array(roof.vertices)
    points[:, 2] += 0.4 * points[:, 0]
    roof.vertices = points
    parts = [*shell(12, 9, 1.0), *scans.table(8, 4), roof]
    with pytest.raises(SceneError) as caught:
        repaired(write(parts, tmp_path / "a.glb", y_up=True), unit="m", up="y")
    text = str(caught.value)
    assert "slopes by 40 %, like a roof" in text
    assert "like the inside of a wall" in text
    assert "walls only under it" in text


# Far away, and far too large --------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".obj", ".glb", ".ply", ".usda"])
@pytest.mark.parametrize("unit_m", [1.0, 0.001])
def test_a_room_far_from_the_origin(suffix: str, unit_m: float, tmp_path: Path) -> None:
    """At UTM coordinates, in metres and in millimetres, in every kind of reader."""
    shift = FAR
    source = tmp_path / f"a{suffix}"
    parts = {name: part.apply_scale(1 / unit_m) for name, part in room().items()}
    if suffix == ".usda":
        write_usd(parts, source, FAR / unit_m, unit_m)
    elif suffix == ".glb":
        write_far_glb(parts, source, FAR / unit_m)
    else:
        write(parts, source, shift=shift / unit_m)
        if suffix == ".ply":
            write_double_ply(source, scans.joined(list(parts.values())), shift / unit_m)
    options = {"up": "z"} if suffix in (".glb", ".ply") else {}
    bundle, record = repaired(source, unit=str(unit_m), **options)
    assert area(record) == pytest.approx(30.0, rel=0.01)
    assert np.abs(bundle.visual().vertices[:, :2]).max() < 100
    assert any("far from the origin" in line for line in record["warnings"])
    assert not any("32-bit" in line for line in record["warnings"])
    # Positions in either frame.
    offset = np.array(record["source"]["offset"])
    assert np.abs(offset[:2] * unit_m - FAR[:2]).max() < 20
    corner = np.append((FAR + np.array([-3, -2.5, 0])) / unit_m, 1.0)
    world = (load_bundle(bundle.root).source_to_world @ corner)[:3]
    # The walls around the floor are 10 cm thick.
    lower = bundle.visual().vertices.min(axis=0) + np.float32(0.1)
    assert world == pytest.approx(lower, abs=0.01)


def write_double_ply(path: Path, mesh: trimesh.Trimesh, shift: np.ndarray) -> None:
    rows = "\n".join(" ".join(repr(float(v)) for v in p) for p in mesh.vertices + shift)
    faces = "\n".join(f"3 {a} {b} {c}" for a, b, c in mesh.faces)
    path.write_text(
        f"ply\nformat ascii 1.0\nelement vertex {len(mesh.vertices)}\nproperty double x\n"
        f"property double y\nproperty double z\nelement face {len(mesh.faces)}\n"
        f"property list uchar int vertex_indices\nend_header\n{rows}\n{faces}\n"
    )


def write_far_glb(parts: Parts, path: Path, shift: np.ndarray) -> None:
    """A root node carries the place, in 64 bits: JSON has no others."""
    scene = trimesh.Scene(base_frame="world")
    place = trimesh.transformations.translation_matrix(shift)
    for name, part in parts.items():
        scene.add_geometry(part, node_name=name, geom_name=name, transform=place)
    scene.export(str(path))


def test_coordinates_rounded_to_32_bits_are_reported(tmp_path: Path) -> None:
    write(room(), tmp_path / "a.stl", shift=FAR)
    scan = read_scan(tmp_path / "a.stl")
    assert any("32-bit numbers, which lie 0.5 units apart" in line for line in scan.warnings)


def sky(radius: float, kind: str) -> trimesh.Trimesh:
    if kind == "sphere":
        return trimesh.creation.icosphere(subdivisions=2, radius=radius)
    if kind == "box":
        return box([-radius] * 3, [radius] * 3)
    if kind == "ground":
        return scans.sheet((-radius, -radius), (radius, radius), z=-0.12, step=radius)
    hills = scans.sheet((-radius, -radius), (radius, radius), z=-0.12, step=radius / 10)
    points = np.array(hills.vertices)
    points[:, 2] += 0.05 * np.maximum(np.abs(points[:, :2]).max(axis=1) - radius / 5, 0)
    return trimesh.Trimesh(points, hills.faces, process=False)


@pytest.mark.parametrize("suffix", [".glb", ".ply"])
@pytest.mark.parametrize(
    "kinds", ["sphere", "box", "ground", "hills", "sphere ground", "box hills"]
)
def test_skies_and_grounds_are_left_out_and_named(kinds: str, suffix: str, tmp_path: Path) -> None:
    far = {f"Far_{kind}": sky(400.0 if k else 900.0, kind) for k, kind in enumerate(kinds.split())}
    parts = {**room(), **far}
    if suffix == ".ply":  # one surface, as a scanner's or a merged export: the room hangs together
        merged = trimesh.boolean.union(list(room().values())[:6], engine="manifold")
        parts = {"room": merged, **far}
    scan = without_parts(read_scan(write(parts, tmp_path / f"a{suffix}")), ())
    assert np.ptp(scan.vertices[scan.faces].reshape(-1, 3), axis=0).max() < 7
    assert sum("left out" in line for line in scan.warnings) == 1
    if suffix == ".glb":
        assert all(name in scan.warnings[-1] for name in far)


HALL = [box((-50, -30, -0.2), (50, 30, 0)), box((-50, -30, 7), (50, 30, 7.2))]
HALL += scans.walls((-50, -30), (50, 30), 7.0)
STOREYS = [scans.sheet((0, 0), (20, 20), z=3.0 * k, step=5.0) for k in range(40)]
LOT = scans.sheet((-20, -20), (20, 20), z=-0.12, step=5.0)
CHAIRS = scans.joined([*scans.table(0, 0), *scans.table(2, 1)])
WHOLE: dict[str, Parts] = {
    "a hall with a few chairs": {"hall": scans.joined(HALL), "chairs": CHAIRS},
    "a house on its lot": {**room(), "lot": LOT},
    "a tower with one table": {
        "tower": scans.joined([*STOREYS, *scans.walls((0, 0), (20, 20), 120.0)]),
        "table": scans.joined(scans.table(5, 5)),
    },
}


@pytest.mark.parametrize("name", WHOLE)
def test_large_buildings_with_little_in_them_are_whole(name: str, tmp_path: Path) -> None:
    scan = read_scan(write(WHOLE[name], tmp_path / "a.glb"))
    assert without_parts(scan, ()) is scan


def test_parts_are_excluded_by_name_or_pattern(tmp_path: Path) -> None:
    scan = read_scan(write(room(), tmp_path / "a.glb", y_up=True))
    assert len(without_parts(scan, ("table", "wall*")).faces) == len(scan.faces) - 5 * 12
    assert "--exclude" in without_parts(scan, ("table",)).warnings[-1]
    with pytest.raises(UnknownNameError, match="did you mean table"):
        without_parts(scan, ("tabel",))
    write_usd(room(), tmp_path / "a.usda", np.zeros(3), 1.0)
    usd = read_scan(tmp_path / "a.usda")
    assert len(without_parts(usd, ("sofa",)).faces) == len(usd.faces) - 12


def test_the_command_takes_all_of_these(
    tmp_path: Path, inline: None, capsys: pytest.CaptureFixture[str]
) -> None:
    parts = {**{f"wall_{k}": wall for k, wall in enumerate(shell())}, "Sky": sky(300.0, "sphere")}
    source = write(parts, tmp_path / "a.glb", y_up=True)
    arguments = ["--floor", "0", "--exclude", "Sky", "--unit", "1.0", "--allow-roof", "--json"]
    assert main(["repair", str(source), "--out", str(tmp_path / "out"), *arguments]) == 0
    facts = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert facts["levels"] == 1
    assert facts["floor_after_m2"] == pytest.approx(108, rel=0.03)
