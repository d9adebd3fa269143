"""Thin spots of captures: loose sheets of faint Gaussians become surfaces, floaters do not."""

from typing import Any

import numpy as np

from vlnpe.formats.core.frames import matrix_to_quat
from vlnpe.formats.splats.record import GaussianCloud
from vlnpe.scene_repair.splats.thin import with_thin_spots_closed

SPACING_M = 0.009


def sheet(kept: float, opacity: float, z_m: float, rng: np.random.Generator) -> GaussianCloud:
    """Return flat Gaussians on a level square of 0.6 m, of which a share is kept."""
    x, y = np.meshgrid(np.arange(0, 0.6, SPACING_M), np.arange(0, 0.6, SPACING_M))
    xy = np.stack([x.ravel(), y.ravel()], axis=1)
    xy = xy[rng.random(len(xy)) < kept]
    count = len(xy)
    size = np.array([0.7 * SPACING_M, 0.7 * SPACING_M, 0.0025], np.float32)
    return GaussianCloud(
        position=np.c_[xy, z_m + rng.normal(0, 0.002, count)].astype(np.float32),
        scale=np.tile(size, (count, 1)),
        quat_wxyz=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        opacity=np.full(count, opacity, np.float32),
        harmonics=np.zeros((count, 1, 3), np.float32),
    )


def joined(*clouds: GaussianCloud) -> GaussianCloud:
    names = ("position", "scale", "quat_wxyz", "opacity", "harmonics")
    fields: dict[str, Any] = {n: np.concatenate([getattr(c, n) for c in clouds]) for n in names}
    return GaussianCloud(**fields)


def test_a_loose_sheet_is_closed_and_a_dense_one_stays() -> None:
    rng = np.random.default_rng(0)
    dense, loose = sheet(1.0, 0.9, 0.0, rng), sheet(0.15, 0.3, 0.5, rng)
    closed = with_thin_spots_closed(joined(dense, loose))
    inner = np.abs(dense.position[:, :2] - 0.3).max(1) < 0.27
    assert np.array_equal(closed.scale[: len(dense)][inner], dense.scale[inner])
    wide = closed.scale[len(dense) :, :2].max(1) > 2 * loose.scale[:, :2].max(1)
    assert wide.mean() > 0.8
    assert (closed.opacity[len(dense) :][wide] >= 0.9).all()
    # It stays as flat as it was: what is widened lies in its plane.
    assert np.array_equal(closed.scale[len(dense) :, 2], loose.scale[:, 2])


def test_floaters_do_not_become_surfaces() -> None:
    rng = np.random.default_rng(1)
    count = 300
    turn = np.linalg.qr(rng.standard_normal((count, 3, 3)))[0]
    turn[np.linalg.det(turn) < 0, :, 0] *= -1
    floaters = GaussianCloud(
        position=rng.uniform(0, 0.6, (count, 3)).astype(np.float32),
        scale=np.tile(np.array([0.01, 0.01, 0.003], np.float32), (count, 1)),
        quat_wxyz=matrix_to_quat(turn).astype(np.float32),
        opacity=np.full(count, 0.3, np.float32),
        harmonics=np.zeros((count, 1, 3), np.float32),
    )
    closed = with_thin_spots_closed(floaters)
    assert (closed.scale != floaters.scale).any(1).mean() < 0.05
    few = floaters.take(np.arange(3))
    assert np.array_equal(with_thin_spots_closed(few).scale, few.scale)
