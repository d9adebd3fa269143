"""Time large captures: `python -m benchmarks.splats.capture scan.ply [--copies 8]`.

Copies of a generated capture, side by side as a larger building (`building`), or within each other
with Gaussians as much smaller as they are more (`dense`). What a user waits for: reading the stored
splats, preparing them, and frames of 256² with 90° at the height of a robot's camera in the rooms.
Times are CPU time of one core; memory is the peak of the whole process.
"""

import argparse
import resource
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from vlnpe.formats.core.camera import CameraModel
from vlnpe.formats.core.frames import HABITAT_TO_WORLD, look_at
from vlnpe.formats.splats.read import read_splats
from vlnpe.formats.splats.record import GaussianCloud, joined
from vlnpe.formats.splats.store import load_splats, save_splats
from vlnpe.geometry.splatting.backend import DETAIL_PX, LEAST_LIGHT
from vlnpe.geometry.splatting.draw import Eye, draw_splats
from vlnpe.geometry.splatting.scene import SplatScene

FRAMES, WARM_UP = 12, 1
EYE_M, GAP_M, COLUMNS = 1.2, 0.3, 4
# Standard deviation of a copy's shift [m]: about the distance between neighbours.
JITTER_M = 0.006
HEAD = (
    "| capture | Gaussians | read s | prepare s | MiB | peak GiB | median ms | slowest ms |\n"
    "|---|---|---|---|---|---|---|---|\n"
)


def building(cloud: GaussianCloud, copies: int) -> GaussianCloud:
    """Return copies of a capture side by side, four in a row."""
    low, high = (np.quantile(cloud.position, q, axis=0) for q in (0.01, 0.99))
    step = high - low + GAP_M
    return joined(
        [
            replace(
                cloud,
                position=cloud.position
                + np.array([k % COLUMNS, k // COLUMNS, 0], np.float32) * step.astype(np.float32),
            )
            for k in range(copies)
        ]
    )


def dense(cloud: GaussianCloud, copies: int, rng: np.random.Generator) -> GaussianCloud:
    """Return a capture with more and smaller Gaussians on the same surfaces."""
    smaller = np.float32(copies**-0.5)
    scale = cloud.scale * np.where(cloud.scale > cloud.scale.min(1, keepdims=True), smaller, 1)
    return joined(
        [
            replace(
                cloud,
                position=cloud.position
                + rng.normal(0, JITTER_M, cloud.position.shape).astype(np.float32)
                * (cloud.scale > 0.004),
                scale=scale.astype(np.float32),
            )
            for _ in range(copies)
        ]
    )


def eyes(cloud: GaussianCloud, rng: np.random.Generator) -> list[Eye]:
    """Return cameras where something is below and above but nothing near, looking around."""
    found = []
    camera = CameraModel("bench", 256, 256, 90.0)
    sample = cloud.position[rng.choice(len(cloud), min(len(cloud), 200_000), replace=False)]
    low, high = (np.quantile(sample[:, :2], q, axis=0) for q in (0.03, 0.97))
    while len(found) < FRAMES + WARM_UP:
        place = np.append(rng.uniform(low, high), EYE_M)
        away = np.linalg.norm(sample - place, axis=1).min()
        if away < 0.4:
            continue
        yaw = rng.uniform(0, 2 * np.pi)
        ahead = np.array([np.cos(yaw), np.sin(yaw), -0.25])
        found.append(Eye(camera, place, look_at(place, place + ahead)))
    return found


def main() -> None:
    """Print one row of a Markdown table for each arrangement."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("capture", type=Path)
    parser.add_argument("--copies", type=int, default=8)
    parser.add_argument("--kind", choices=("building", "dense"), default="building")
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    one = read_splats(options.capture).transformed(HABITAT_TO_WORLD)
    # Without the far background, which copies of would hang in their neighbours' rooms.
    middle = np.median(one.position, axis=0)
    one = one.take(np.linalg.norm(one.position - middle, axis=1) < 15)
    args = (one, options.copies)
    cloud = building(*args) if options.kind == "building" else dense(*args, rng)
    views = eyes(cloud, rng)
    with tempfile.TemporaryDirectory() as folder:
        save_splats(Path(folder), cloud)
        del cloud, one
        start = time.process_time()
        cloud = load_splats(Path(folder))
    read = time.process_time() - start
    scene = SplatScene.of(cloud, detail=True)
    ready, count = time.process_time() - start - read, len(cloud)
    del cloud
    spent = []
    for eye in views:
        start = time.process_time()
        draw_splats(scene, eye, detail_px=DETAIL_PX, least_light=LEAST_LIGHT)
        spent.append(1e3 * (time.process_time() - start))
    spent = spent[WARM_UP:]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    sys.stdout.write(
        f"{HEAD}| {options.kind} of {options.copies} | {count:,} | {read:.1f} | {ready:.1f} | "
        f"{scene.nbytes / 2**20:.0f} | {peak:.1f} | {np.median(spent):.0f} | {max(spent):.0f} |\n"
    )


if __name__ == "__main__":
    main()
