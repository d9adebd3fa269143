"""Fuse the surface that splats show: depth from many virtual cameras into one volume.

Lengths are normalised first, so that a building of ordinary size has voxels of about 2.5 cm: the
fusion's thresholds are made for rooms.
"""

from collections.abc import Callable, Iterable

import numpy as np
from scipy import sparse
from scipy.spatial import KDTree

from ...formats.core.arrays import F32, U8, Array
from ...formats.core.camera import CameraModel
from ...formats.core.errors import SceneError
from ...formats.splats.harmonics import C0
from ...formats.splats.record import GaussianCloud
from ...geometry.fusion.surface import ScanMesh, extract
from ...geometry.fusion.volume import DistanceVolume
from ...geometry.splatting.draw import Eye, SplatImage, draw_splats
from ...geometry.splatting.scene import SplatScene
from ..grid.morphology import label
from .closer import closer_views
from .solid import Solid
from .thin import with_thin_spots_closed

VOXELS, VOXEL_M = 24_000_000, 0.025
MARGIN_VOXELS = 8
# Cameras look along the six sides of a cube, so that none is missing whichever way is up.
# A pixel's blur makes floor seen at a grazing angle rise towards the camera: with 256 pixels a
# third as much floor is over 10 mm off as with 128.
SIDE_PX, HFOV_DEG = 256, 92.0
STATIONS, STATION_SPACING_M, STATION_CLEARANCE_M = 72, 0.9, 0.22
LEAST_SPACE_M3 = 0.8
# Rounds of further cameras for what the stations do not see.
CLOSER_ROUNDS = 2
RANGE_M, NEAR_M = (0.12, 5.0), 0.06
# The mean depth is taken where it is this close to the median: further off, part of it is the depth
# of something else, which would draw the floor beside furniture up.
MEAN_MEDIAN_M = 0.005
# Where more light than this gets through there is no surface.
MAX_LIGHT = 0.35
TARGET_FACES = 320_000
# Of a voxel: about that of two views from two metres; what is seen less often is ragged.
LEAST_WEIGHT = 0.5
SMOOTHING_ROUNDS, SMOOTHING_STEPS = 6, (0.5, -0.53)
SIDES = tuple(
    np.stack([np.cross(down, ahead), down, ahead], axis=1)
    for down, ahead in (
        (np.eye(3)[(axis + 1) % 3], sign * np.eye(3)[axis]) for axis in range(3) for sign in (1, -1)
    )
)


def fuse_splats(
    cloud: GaussianCloud, solid: Solid, progress: Callable[[str], None]
) -> tuple[ScanMesh, U8]:
    """Return the surface in units of the file, and sRGB (V, 3); raise SceneError if none shows."""
    volume_units = float(np.prod(solid.upper - solid.lower))
    factor = VOXEL_M / (volume_units / VOXELS) ** (1 / 3)
    similarity = np.diag([factor, factor, factor, 1.0])
    surfaces = cloud.take(solid.keep).transformed(similarity)
    surfaces = with_thin_spots_closed(surfaces)
    scene = SplatScene.of(surfaces, antialiased=False)
    margin = MARGIN_VOXELS * VOXEL_M
    volume = DistanceVolume.empty(
        factor * solid.lower - margin, factor * solid.upper + margin, VOXEL_M
    )
    places = stations(solid, factor)
    if not len(places):
        raise SceneError(
            "its Gaussians enclose no space that a camera could stand in: an object, not a room, "
            "or a part of one that is open on two sides or more; give its "
            "surface with --collision"
        )
    progress(f"looking from {len(places)} places at {len(surfaces):,} Gaussians")
    camera = CameraModel("virtual", SIDE_PX, SIDE_PX, HFOV_DEG)
    _look(scene, volume, (Eye(camera, place, side) for place in places for side in SIDES))
    for _ in range(CLOSER_ROUNDS):
        views = closer_views(surfaces, volume, solid, factor)
        if not views:
            break
        progress(f"looking closer at {len(views)} places")
        _look(scene, volume, (Eye(camera, *view) for view in views))
    progress("meshing")
    if not ((volume.value < 0) & (volume.weight > LEAST_WEIGHT)).any():
        raise SceneError("no surface could be fused from its Gaussians")
    mesh = smoothed(extract(volume, TARGET_FACES, LEAST_WEIGHT))
    color = _colors(surfaces, mesh.vertices)
    return ScanMesh(mesh.vertices / factor, mesh.faces), color


def smoothed(mesh: ScanMesh) -> ScanMesh:
    """Return the mesh without the scatter of the Gaussians (Taubin's smoothing, 1995)."""
    count = len(mesh.vertices)
    edges = mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    both = np.concatenate([edges, edges[:, ::-1]])
    ones = np.ones(len(both), dtype=np.float64)
    links = sparse.coo_matrix((ones, (both[:, 0], both[:, 1])), shape=(count, count)).tocsr()
    degree = np.maximum(np.asarray(links.sum(axis=1)), 1)
    points = mesh.vertices
    for _ in range(SMOOTHING_ROUNDS):
        for step in SMOOTHING_STEPS:
            points = points + step * (links @ points / degree - points)
    return ScanMesh(points, mesh.faces)


def stations(solid: Solid, factor: float) -> Array:
    """Return camera positions (S, 3) spread over the enclosed space, normalised lengths."""
    clear = solid.clearance * factor
    open_ = clear > STATION_CLEARANCE_M
    part, _ = label(open_)
    volume_m3 = np.bincount(part.ravel()) * (factor * solid.cell) ** 3
    # A camera inside a bed or a wall would see surfaces from behind.
    cells = np.argwhere(open_ & (volume_m3 >= LEAST_SPACE_M3)[part])
    if not len(cells):
        return np.zeros((0, 3))
    points = factor * (solid.origin + solid.cell * cells)
    # Starting where most room is; each next one is furthest from all so far.
    k = int(np.argmax(clear[tuple(cells.T)]))
    distance = np.full(len(points), np.inf)
    chosen = []
    while len(chosen) < STATIONS:
        chosen.append(points[k])
        distance = np.minimum(distance, np.linalg.norm(points - points[k], axis=1))
        k = int(np.argmax(distance))
        if distance[k] < STATION_SPACING_M:
            break
    return np.array(chosen)


def surface_depth(image: SplatImage) -> F32:
    """Return the depth (H, W) [m] at which half of the light is gone; 0 = none to be trusted."""
    close = np.abs(image.depth_m - image.median_m) < MEAN_MEDIAN_M
    depth = np.where(close, image.depth_m, image.median_m)
    good = (image.light < MAX_LIGHT) & (depth > RANGE_M[0]) & (depth < RANGE_M[1])
    return np.where(good, depth, 0).astype(np.float32)


def _look(scene: SplatScene, volume: DistanceVolume, eyes: Iterable[Eye]) -> None:
    """Add the depth images of `eyes` to the volume."""
    for eye in eyes:
        image = draw_splats(scene, eye, with_depth=True, near_m=NEAR_M)
        volume.integrate(
            surface_depth(image),
            focal_px=eye.camera.focal_px,
            position_m=eye.position_world_m,
            rotation=eye.rotation_world,
        )


def _colors(cloud: GaussianCloud, points: Array) -> U8:
    """Return the colours (V, 3) of the Gaussians nearest to points (V, 3)."""
    _, near = KDTree(cloud.position).query(points, k=4)
    rgb = 0.5 + C0 * cloud.harmonics[:, 0]
    weight = cloud.opacity[near][..., None]
    mean = (rgb[near] * weight).sum(1) / weight.sum(1)
    return np.rint(255 * np.clip(mean, 0, 1)).astype(np.uint8)
