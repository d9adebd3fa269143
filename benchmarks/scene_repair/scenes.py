"""Scenes with known floors: built-in apartments, and real scans beside the repository."""

import hashlib
import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import ndimage

from vlnpe.apartments.config import ApartmentConfig, ScanConfig
from vlnpe.apartments.generate import generate_scan
from vlnpe.formats.core.arrays import Array
from vlnpe.formats.core.frames import habitat_to_world_position
from vlnpe.formats.scene.grid import GridSpec

from .planting.glb import Glb
from .planting.plant import Planted, replaced
from .site import Site, filled, floor_height, survey

TUNING_SEEDS = tuple(range(20))
HELD_OUT_SEEDS = tuple(range(1000, 1020))
SHARED = Path(__file__).resolve().parents[3] / "shared" / "scenes"
HOUSE = "small_house"
HEADSETS = ("quest_living_room", "quest_music_room", "quest_office_small")
# Geometry as the product scans it; only the painting is coarser, which no hole depends on.
SCAN = replace(ScanConfig(), texel_m=0.03, floor_texel_m=0.015, light_rays=8)
APARTMENT = replace(ApartmentConfig(), scan=SCAN)


@dataclass(frozen=True)
class Source:
    """A scan file and facts about it."""

    path: Path
    site: Site


def scan_folder(seed: int, cache: Path) -> Path:
    """Return where the apartment of a seed lies, scanned into `cache` unless it was before."""
    key = hashlib.sha256(repr(APARTMENT).encode()).hexdigest()[:12]
    folder = cache / f"apartment-{seed}-{key}"
    if not (folder / "truth.npz").is_file():
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        generate_scan(seed, folder, APARTMENT, lambda _: None)
    return folder


def apartment(seed: int, cache: Path) -> Source:
    """Return the built-in apartment of a seed."""
    folder = scan_folder(seed, cache)
    with np.load(folder / "truth.npz", allow_pickle=False) as truth:
        rows, columns = (int(v) for v in truth["shape"])
        x, y = (float(v) for v in truth["origin_xy_m"])
        grid = GridSpec((x, y), float(truth["cell_m"]), rows, columns)
        floor = truth["floor_mask"]
    # Outer walls have the thickness of the others; one cell more is the masks' own precision.
    margin = round(APARTMENT.wall_m / grid.cell_m) + 1
    closed = ndimage.binary_closing(np.pad(floor, 2 * margin), iterations=margin)
    grown = filled(ndimage.binary_dilation(closed, np.ones((3, 3)), iterations=margin))
    building = grown[2 * margin : -2 * margin, 2 * margin : -2 * margin]
    boxes = json.loads((folder / "scan.labels.json").read_text())["objects"]
    doors = [_box_in_plan(b) for b in boxes if b["category"] == "door frame"]
    rugs = [_box_in_plan(b) for b in boxes if b["category"] == "rug"]
    path = folder / "scan.glb"
    return Source(
        path,
        survey(
            f"apartment {seed}",
            Glb(path).parts(),
            0.0,
            exact=True,
            true_floor=(grid, floor),
            building=building,
            doors=doors,
            rugs=rugs,
        ),
    )


def house(folder: Path = SHARED) -> Source:
    """Return the furnished house."""
    path = folder / f"{HOUSE}.glb"
    parts = Glb(path).parts()
    doors = [
        (p.points_m.min(axis=0)[:2] - 0.05, p.points_m.max(axis=0)[:2] + 0.05)
        for p in parts
        if p.name.startswith("FoldingDoor")  # the others lead out of the house
    ]
    slabs = [p for p in parts if p.name.startswith("Floor")]
    z = float(np.median(np.concatenate([p.points_m[:, 2] for p in slabs])))
    walls = [p for p in parts if "Wall" in p.name]
    return Source(path, survey(HOUSE, parts, z, exact=False, doors=doors, wall_parts=walls))


def headset(name: str, folder: Path = SHARED) -> Source:
    """Return a headset's scan of one room, closed, with a labelled floor plane."""
    path = folder / f"{name}.glb"
    anchors = json.loads((folder / f"{name}.labels.json").read_text())
    floor = next(a for a in anchors if a["label"] == "FLOOR")
    # The label's plane and the mesh differ by up to 6 cm.
    parts = Glb(path).parts()
    z = floor_height(parts, float(floor["pose"]["position"]["y"]))
    return Source(path, survey(name, parts, z, exact=False))


def write_planted(planted: Planted, source: Source, out: Path) -> Path:
    """Write the scan with its holes, and the labels beside it; the source's name is kept."""
    glb = Glb(source.path)
    for part in replaced(planted):
        glb.replace(part)
    for decoy in planted.decoys:
        corners = decoy.triangles_m.reshape(-1, 3)
        faces = np.arange(len(corners), dtype=np.int64).reshape(-1, 3)
        glb.add(decoy.name, corners, faces, (0.7, 0.69, 0.66))
    path = out / source.path.name
    glb.write(path)
    labels = source.path.with_name(f"{source.path.stem}.labels.json")
    if labels.is_file():
        shutil.copyfile(labels, out / labels.name)
    return path


def _box_in_plan(entry: dict) -> tuple[Array, Array]:
    ends = habitat_to_world_position(np.array([entry["lower"], entry["upper"]]))[:, :2]
    return ends.min(axis=0), ends.max(axis=0)
