"""Reconstruct a surface from a point cloud; runs in a child process, see `sandbox`.

Screened Poisson reconstruction (Kazhdan and Hoppe, 2013) as open3d has it, cut back to where points
are. Everything is seeded and runs on one thread, so that the same file gives the same surface.
"""

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from ...formats.core.arrays import I64, Array
from ...formats.core.errors import FileFormatError, InputError, MissingExtraError
from ...formats.core.geometry import coarse_warning, far_offset
from ...formats.splats.ply_header import read_ply_header
from .headers import check_pcd
from .readings import LookRef, Readings
from .record import DEFAULT_COLOR
from .soup import MAX_COORDINATE, Part

LIBRARIES = "libgl1 libgomp1 libusb-1.0-0 libx11-6"
# More points than this are thinned out evenly first; a room has 2 cm between them then.
MAX_POINTS = 400_000
LEAST_POINTS = 100
NEIGHBOURS = 24
# How many typical distances between points one cell of the reconstruction takes.
CELL_SPACINGS, MIN_DEPTH, MAX_DEPTH = 1.5, 5, 10
# Surface further from any point than this many typical distances was never seen, and neither was
# that which this share of the thinnest supported surface is made of.
TRIM_SPACINGS, TRIM_SHARE = 4.0, 0.01


def read(path: Path) -> Readings:
    """Reconstruct a coloured surface from the points of a PLY or PCD file.

    Raises:
        FileFormatError: damaged, or too few points for a surface.
        InputError: open3d is not installed, or cannot be loaded.
    """
    if path.suffix.lower() == ".pcd":
        check_pcd(path)
    else:
        read_ply_header(path)
    o3d = _open3d()
    warnings: list[str] = []
    points, colors, normals = _points(o3d, path, warnings)
    offset = far_offset(points)
    warnings += coarse_warning(points, offset) if offset.any() else []
    points = points - offset  # the reconstruction counts in 32 bits
    points, colors, normals, spacing = _thinned(points, colors, normals)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    if normals is None:
        _estimate_normals(o3d, cloud, points)
    else:
        cloud.normals = o3d.utility.Vector3dVector(normals)
    vertices, faces = _surface(o3d, cloud, points, spacing)
    if not len(faces):
        raise FileFormatError(
            path, f"no surface could be reconstructed from its {len(points):,} points"
        )
    warnings.append(
        f"surface of {len(faces):,} triangles through {len(points):,} points, "
        f"typically {spacing:.3g} units apart"
    )
    painted = None
    if colors is not None:
        # One colour a vertex from the nearest points, which even out the sensor's noise.
        _, near = KDTree(points).query(vertices, k=4)
        at_vertex = colors[near].mean(axis=1)
        painted = np.rint(255 * np.clip(at_vertex, 0, 1)).astype(np.uint8)[faces]
    uv, look = np.zeros((len(faces), 3, 2), "f4"), LookRef("points", DEFAULT_COLOR)
    part = Part("cloud", "", vertices + offset, faces, uv, look, painted)
    return Readings([part], None, None, warnings)


def _open3d() -> Any:
    if importlib.util.find_spec("open3d") is None:
        raise MissingExtraError("reading a point cloud", "scan")
    try:
        import open3d as o3d
    # What is missing is a library of the system, raised as an ImportError or an OSError.
    except Exception as error:
        raise InputError(
            f"open3d cannot be loaded ({str(error).splitlines()[0]}); it needs system libraries: "
            f"apt-get install {LIBRARIES}"
        ) from error
    o3d.utility.random.seed(0)
    o3d.utility.set_verbosity_level(o3d.utility.VerbosityLevel.Error)
    return o3d


def _points(o3d: Any, path: Path, warnings: list[str]) -> tuple[Array, Array | None, Array | None]:
    """Return finite points (N, 3), and their sRGB colours in 0–1 and normals if there are any."""
    cloud = o3d.io.read_point_cloud(
        str(path), remove_nan_points=False, remove_infinite_points=False
    )
    points = np.asarray(cloud.points)
    usable = np.isfinite(points).all(axis=1) & (np.abs(points) < MAX_COORDINATE).all(axis=1)
    if not usable.all():
        warnings.append(f"{int((~usable).sum())} points with invalid coordinates dropped")
    if usable.sum() < LEAST_POINTS:
        raise FileFormatError(
            path,
            f"contains {int(usable.sum())} usable points and no triangles; "
            f"valid: at least {LEAST_POINTS}",
        )
    colors = np.asarray(cloud.colors)[usable] if cloud.has_colors() else None
    normals = np.asarray(cloud.normals)[usable] if cloud.has_normals() else None
    if normals is not None:
        length = np.linalg.norm(normals, axis=1)
        unit = np.isfinite(length).all() and (np.abs(length - 1.0) < 0.1).mean() > 0.99
        normals = normals / np.maximum(length, 1e-9)[:, None] if unit else None
        if not unit:
            warnings.append("normals do not have unit length; estimated again")
    return points[usable], None if colors is None else np.nan_to_num(colors), normals


def _thinned(
    points: Array, colors: Array | None, normals: Array | None
) -> tuple[Array, Array | None, Array | None, float]:
    """Thin the points to one per cell, at most `MAX_POINTS`; return their median spacing, too."""
    sample = points[:: max(1, len(points) // 20_000)]
    near, _ = KDTree(points).query(sample, k=2)
    cell = max(float(np.median(near[:, 1])), float(np.ptp(points, axis=0).max()) * 1e-6)
    origin = points.min(axis=0)
    while True:
        index = np.floor((points - origin) / cell).astype(np.int64)
        span = index.max(axis=0) + 1
        key = (index[:, 0] * span[1] + index[:, 1]) * span[2] + index[:, 2]
        _, first = np.unique(key, return_index=True)
        if len(first) <= MAX_POINTS:
            break
        cell *= 1.25
    rows = np.sort(first)
    points = points[rows]
    sample = points[:: max(1, len(points) // 20_000)]
    near, _ = KDTree(points).query(sample, k=2)
    return (
        points,
        None if colors is None else colors[rows],
        None if normals is None else normals[rows],
        max(float(np.median(near[:, 1])), 1e-12),
    )


def _estimate_normals(o3d: Any, cloud: Any, points: Array) -> None:
    """Estimate normals that agree with their neighbours; what is outermost faces inwards."""
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS))
    cloud.orient_normals_consistent_tangent_plane(NEIGHBOURS)
    normals = np.asarray(cloud.normals)
    inward = np.median(points, axis=0) - points
    distance = np.linalg.norm(inward, axis=1)
    outer = distance > np.quantile(distance, 0.5)
    if np.einsum("nd,nd->n", normals, inward)[outer].sum() < 0:
        cloud.normals = o3d.utility.Vector3dVector(-normals)


def _surface(o3d: Any, cloud: Any, points: Array, spacing: float) -> tuple[Array, I64]:
    """Return vertices and faces of the reconstruction where points support it."""
    extent = float(np.ptp(points, axis=0).max())
    depth = int(
        np.clip(np.ceil(np.log2(1.1 * extent / (CELL_SPACINGS * spacing))), MIN_DEPTH, MAX_DEPTH)
    )
    mesh, density = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        cloud, depth=depth, n_threads=1
    )
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles).astype(np.int64)
    density = np.asarray(density)
    far, _ = KDTree(points).query(vertices)
    supported = far <= TRIM_SPACINGS * max(spacing, extent / 2**depth / CELL_SPACINGS)
    supported &= (
        density >= np.quantile(density[supported], TRIM_SHARE) if supported.any() else False
    )
    return vertices, faces[supported[faces].all(axis=1)]
