"""Other hole fillers on the same planted scans, by the same measure.

Each runs in a process of its own: they may take very long, and one is known to crash.
"""

import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from .planting.glb import Glb
from .planting.plant import Planted
from .score import COUNTED_FROM_M, HoleScore, score_hole, truth_of
from .site import NEAR_FLOOR_M, soup_of
from .vertical import Surfaces

# The circle around the largest planted hole, which is the size that pyvista asks for.
LARGEST_RADIUS_M = 1.1
TIMEOUT_S = 180.0

Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]


@dataclass(frozen=True)
class FillerScore:
    """What a filler made of one scene.

    Attributes:
        filler: its name.
        holes: the planted ones, and decoys.
        seconds: it took, without reading the file.
        failed: why there is no result; empty if there is one.
    """

    filler: str
    holes: list[HoleScore]
    seconds: float
    failed: str = ""


def by_trimesh(mesh: Mesh) -> Mesh:
    """Return `trimesh.repair.fill_holes`: triangles and quads only."""
    return _by_trimesh(mesh, False)


def by_trimesh_fan(mesh: Mesh) -> Mesh:
    """Return `trimesh.repair.fill_holes` with fans for larger holes."""
    return _by_trimesh(mesh, True)


def _by_trimesh(mesh: Mesh, use_fan: bool) -> Mesh:
    whole = trimesh.Trimesh(*mesh, process=False)
    trimesh.repair.fill_holes(whole, use_fan=use_fan)
    return np.asarray(whole.vertices), np.asarray(whole.faces)


def by_pyvista(mesh: Mesh) -> Mesh:
    """Return `pyvista.PolyData.fill_holes` up to the largest planted size."""
    import pyvista

    filled = pyvista.PolyData.from_regular_faces(*mesh).fill_holes(LARGEST_RADIUS_M)
    triangles = filled.triangulate()
    return np.asarray(triangles.points), triangles.regular_faces.astype(np.int64)


FILLERS: dict[str, Callable[[Mesh], Mesh]] = {
    "trimesh": by_trimesh,
    "trimesh, fan": by_trimesh_fan,
    "pyvista": by_pyvista,
}


def compare(planted: Planted, scan: Path, folder: Path) -> list[FillerScore]:
    """Let every filler work on a planted scan.

    Args:
        planted: what was planted.
        scan: its file.
        folder: for intermediate files.
    """
    truth, site = truth_of(planted), planted.site
    results = []
    for name in FILLERS:
        out = folder / "filled.npz"
        out.unlink(missing_ok=True)
        command = [sys.executable, "-m", "benchmarks.scene_repair.fillers", name, scan, out]
        try:
            done = subprocess.run(command, capture_output=True, timeout=TIMEOUT_S)
            failed = "" if done.returncode == 0 else f"crashed with code {done.returncode}"
        except subprocess.TimeoutExpired:
            failed = f"not done after {TIMEOUT_S:.0f} s"
        if failed:
            results.append(FillerScore(name, [], TIMEOUT_S, failed))
            continue
        with np.load(out, allow_pickle=False) as data:
            z = site.floor_z_m
            surfaces = Surfaces.between(
                data["vertices"], data["faces"], z - NEAR_FLOOR_M, z + NEAR_FLOOR_M
            )
            seconds = float(data["seconds"])
        holes = [score_hole(truth, hole, surfaces) for hole in planted.holes]
        results.append(FillerScore(name, holes, seconds))
    return results


def table(ours: list[tuple[list[HoleScore], float]], others: list[FillerScore]) -> list[str]:
    """Return a Markdown table of this repair and the others, over the same scenes."""
    lines = [
        "| filler | planted area filled | planted holes filled | decoys wrongly filled "
        "| s per scene | failed |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    rows = {"`vlnpe repair` (all of it)": [(holes, s, "") for holes, s in ours]}
    for result in others:
        rows.setdefault(f"{result.filler}", []).append(
            (result.holes, result.seconds, result.failed)
        )
    for name, cases in rows.items():
        holes = [h for holes, _, _ in cases for h in holes if not h.hole.decoy and h.area_m2 > 0]
        holes = [h for h in holes if h.hole.size_m >= COUNTED_FROM_M]
        decoys = [h for holes, _, _ in cases for h in holes if h.hole.decoy]
        area = max(sum(h.area_m2 for h in holes), 1e-9)
        lines.append(
            f"| {name} | {100 * sum(h.filled_m2 for h in holes) / area:.1f} % "
            f"| {100 * sum(h.filled for h in holes) / max(len(holes), 1):.1f} % "
            f"| {sum(h.filled for h in decoys)} of {len(decoys)} "
            f"| {np.mean([s for _, s, _ in cases]):.1f} | {sum(bool(f) for _, _, f in cases)} |"
        )
    return lines


def _child(name: str, scan: Path, out: Path) -> None:
    vertices, faces = soup_of(Glb(scan).parts())
    # Holes are seen only where vertices are shared.
    vertices, inverse = np.unique(vertices.round(6), axis=0, return_inverse=True)
    faces = inverse.ravel()[faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    started = time.perf_counter()
    vertices, faces = FILLERS[name]((vertices, faces))
    seconds = time.perf_counter() - started
    np.savez(out, vertices=vertices, faces=faces, seconds=seconds)


if __name__ == "__main__":
    _child(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))
