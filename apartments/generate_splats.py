"""Capture a built-in scene as Gaussian splats.

Not imported by the package, so that an edit of it does not scan buildings as meshes again.
"""

from pathlib import Path

import numpy as np

from ..formats.core.frames import HABITAT_TO_WORLD, quat_to_matrix
from ..formats.splats.ply import write_ply_splats
from ..formats.splats.record import GaussianCloud
from ..geometry.fusion.surface import ScanMesh
from .config import ApartmentConfig
from .output import LICENCE, Progress, begin, scan_pose, write_labels
from .scanner.splat_faults import with_faults
from .scanner.splats import place_splats
from .scanner.tracing import Tracer
from .truth import write_truth

# Gaussians on surfaces.
SPLATS = 1_200_000


def generate_splats(
    seed: int,
    out_dir: Path,
    config: ApartmentConfig = ApartmentConfig(),  # noqa: B008  (frozen)
    progress: Progress | None = None,
    count: int = SPLATS,
) -> Path:
    """Generate the building of `seed` and capture it as about `count` Gaussian splats.

    Writes `scan.ply` (3D Gaussian splatting, y up, metres), `scan.labels.json` and `truth.npz` as
    `generate_scan` does, whose building is the same, and returns the path of `scan.ply`.
    """
    rng, scene, report = begin(seed, config, progress)
    report("placing Gaussians")
    cloud = place_splats(rng, scene, Tracer(scene.shape.corners), config.scan, count)
    seen = floor_patches(cloud)
    cloud, faults = with_faults(rng, scene, cloud)
    report(f"writing {len(cloud):,} Gaussians, {faults.floaters:,} of them floaters")
    pose = scan_pose(config)
    in_file = cloud.transformed(np.linalg.inv(HABITAT_TO_WORLD) @ pose)
    write_ply_splats(out_dir / "scan.ply", in_file, (f"licence {LICENCE}", f"seed {seed}"))
    write_labels(out_dir / "scan.labels.json", scene, pose)
    write_truth(out_dir / "truth.npz", scene.storeys, seen, pose)
    return out_dir / "scan.ply"


def floor_patches(cloud: GaussianCloud) -> ScanMesh:
    """Return a triangle on every Gaussian that lies flat: where a capture has seen floor."""
    axes = quat_to_matrix(cloud.quat_wxyz)
    flat = np.abs(axes[:, 2, 2]) > 0.9
    reach = 2 * cloud.scale[flat, :1]
    center = cloud.position[flat]
    corners = [center + reach * np.array(to) for to in ((-1, -1, 0), (1, -1, 0), (0, 1, 0))]
    return ScanMesh.of_corners(np.stack(corners, axis=1).astype(np.float64))
