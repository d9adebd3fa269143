"""Time the CPU rasteriser over numbers of Gaussians: `python -m benchmarks.splats [--large]`.

Rooms of 4 × 4 × 2.6 m whose walls are covered by Gaussians; cameras at random places in them, 256²
with 90°. Times are CPU time of one core, the median and the slowest of 20 frames: of the whole
capture, as the published formula has it, and as the renderer draws, with levels of detail, whose
error is the PSNR against the first.
"""

import argparse
import sys
import time

import numpy as np

from vlnpe.formats.core.arrays import Array
from vlnpe.formats.core.camera import CameraModel
from vlnpe.formats.core.frames import look_at, matrix_to_quat
from vlnpe.formats.splats.record import GaussianCloud
from vlnpe.geometry.splatting.backend import DETAIL_PX, LEAST_LIGHT
from vlnpe.geometry.splatting.draw import Eye, SplatImage, draw_splats
from vlnpe.geometry.splatting.scene import SplatScene

COUNTS = (100_000, 300_000, 600_000, 1_500_000, 3_000_000, 5_000_000)
LARGE = (*COUNTS, 10_000_000)
FRAMES, WARM_UP = 20, 2
PITCH_M = 4.1
HEAD = (
    "| Gaussians | prepare s | memory MiB | whole: median ms | slowest ms | drawn: median ms "
    "| slowest ms | PSNR median dB | least dB |\n|---|---|---|---|---|---|---|---|---|\n"
)


def rooms(across: int, down: int) -> list[tuple[Array, Array, Array]]:
    """Return the rectangles (corner and two sides) of a grid of rooms with doorways."""
    sides = []
    for i in range(across):
        for j in range(down):
            x, y = PITCH_M * i, PITCH_M * j
            sides += [((x, y, z), (4, 0, 0), (0, 4, 0)) for z in (0.0, 2.6)]
            sides += [((x, y + 4 * k, 0), (4, 0, 0), (0, 0, 2.6)) for k in (0, 1)]
            sides += [
                ((x + 4 * k, y + start, 0), (0, 1.5, 0), (0, 0, 2.6))
                for k in (0, 1)
                for start in (0, 2.5)
            ]
    return [tuple(np.array(v, dtype=float) for v in side) for side in sides]  # type: ignore[misc]


def covered(rng: np.random.Generator, count: int, degree: int) -> GaussianCloud:
    """Return `count` Gaussians on the walls of six rooms."""
    walls = rooms(3, 2)
    area = np.array([np.linalg.norm(np.cross(u, v)) for _, u, v in walls])
    wall = rng.choice(len(walls), count, p=area / area.sum())
    corner, u, v = (np.array([w[k] for w in walls]) for k in range(3))
    a, b = rng.random((2, count, 1))
    axes = [side / np.linalg.norm(side, axis=1, keepdims=True) for side in (u, v)]
    turn = matrix_to_quat(np.stack([*axes, np.cross(*axes)], axis=2))
    spacing = np.sqrt(area.sum() / count)
    size = spacing * rng.uniform(0.5, 1.0, (count, 1)) * (1, 1, 0.1)
    return GaussianCloud(
        position=(corner[wall] + a * u[wall] + b * v[wall]).astype(np.float32),
        scale=size.astype(np.float32),
        quat_wxyz=turn[wall].astype(np.float32),
        opacity=rng.uniform(0.3, 0.99, count).astype(np.float32),
        harmonics=rng.uniform(-1, 1, (count, (degree + 1) ** 2, 3)).astype(np.float32),
    )


def eyes(rng: np.random.Generator) -> list[Eye]:
    """Return cameras in the rooms that look around, a little down."""
    camera = CameraModel("bench", 256, 256, 90.0)
    result = []
    for _ in range(FRAMES + WARM_UP):
        position = np.array([rng.uniform(0.5, 12), rng.uniform(0.5, 7.7), 1.2])
        yaw = rng.uniform(0, 2 * np.pi)
        ahead = np.array([np.cos(yaw), np.sin(yaw), -0.25])
        result.append(Eye(camera, position, look_at(position, position + ahead)))
    return result


def main() -> None:
    """Print one row of a Markdown table for each number of Gaussians."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--large", action="store_true", help="up to 10 million Gaussians")
    parser.add_argument("--counts", type=int, nargs="+", help="these numbers of Gaussians instead")
    parser.add_argument("--degree", type=int, default=0, help="degree of the harmonics")
    options = parser.parse_args()
    say = sys.stdout.write
    counts = options.counts or (LARGE if options.large else COUNTS)
    say(HEAD)
    for count in counts:
        rng = np.random.default_rng(0)
        cloud = covered(rng, count, options.degree)
        start = time.process_time()
        scene = SplatScene.of(cloud, detail=True)
        ready = time.process_time() - start
        del cloud
        whole, drawn, error = [], [], []
        for eye in eyes(rng):
            image, spent = timed(scene, eye)
            whole.append(spent)
            faster, spent = timed(scene, eye, DETAIL_PX, LEAST_LIGHT)
            drawn.append(spent)
            error.append(psnr_db(faster, image))
        whole, drawn, error = whole[WARM_UP:], drawn[WARM_UP:], error[WARM_UP:]
        say(
            f"| {count:,} | {ready:.1f} | {scene.nbytes / 2**20:.0f} | {np.median(whole):.0f} | "
            f"{max(whole):.0f} | {np.median(drawn):.0f} | {max(drawn):.0f} | "
            f"{np.median(error):.0f} | {min(error):.0f} |\n"
        )
        sys.stdout.flush()


def timed(
    scene: SplatScene, eye: Eye, detail_px: float = 0.0, least_light: float = 0.0
) -> tuple[SplatImage, float]:
    """Return an image and the CPU time it took [ms]."""
    start = time.process_time()
    image = draw_splats(scene, eye, detail_px=detail_px, least_light=least_light)
    return image, 1e3 * (time.process_time() - start)


def psnr_db(image: SplatImage, other: SplatImage) -> float:
    """Return the peak signal-to-noise ratio of two images' colours [dB]."""
    error = np.mean((np.clip(image.color, 0, 1) - np.clip(other.color, 0, 1)) ** 2)
    return float(-10 * np.log10(max(error, 1e-12)))


if __name__ == "__main__":
    main()
