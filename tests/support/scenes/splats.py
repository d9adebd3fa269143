"""Small random Gaussian clouds, and their comparison."""

import numpy as np
import pytest

from vlnpe.formats.splats.record import GaussianCloud, covariances


def random_cloud(
    rng: np.random.Generator,
    count: int,
    degree: int = 0,
    *,
    spread: float = 1.0,
    sizes: tuple[float, float] = (0.02, 0.2),
) -> GaussianCloud:
    """Return Gaussians around the origin with random sizes, turns, opacities and colours."""
    low, high = np.log(sizes)
    quat = rng.standard_normal((count, 4))
    harmonics = rng.uniform(-0.6, 0.6, (count, (degree + 1) ** 2, 3))
    harmonics[:, 0] = rng.uniform(-1.5, 1.5, (count, 3))
    return GaussianCloud(
        position=(spread * rng.standard_normal((count, 3))).astype(np.float32),
        scale=np.exp(rng.uniform(low, high, (count, 3))).astype(np.float32),
        quat_wxyz=(quat / np.linalg.norm(quat, axis=1, keepdims=True)).astype(np.float32),
        opacity=rng.uniform(0.05, 0.99, count).astype(np.float32),
        harmonics=harmonics.astype(np.float32),
    )


def assert_same(read: GaussianCloud, cloud: GaussianCloud, tolerance: float) -> None:
    """Assert that a cloud that was read is the one that was written, up to `tolerance`."""
    assert read.position == pytest.approx(cloud.position, abs=tolerance)
    assert read.opacity == pytest.approx(cloud.opacity, abs=tolerance)
    assert read.harmonics == pytest.approx(cloud.harmonics, abs=4 * tolerance)
    close = 8 * tolerance * float(np.abs(covariances(cloud)).max())
    assert covariances(read) == pytest.approx(covariances(cloud), abs=close)
