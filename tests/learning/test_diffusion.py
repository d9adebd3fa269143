"""The schedule of noise gives the numbers that it gave before it was diffusers'."""

import pytest
import torch

from vlnpe.learning.models.diffusion import NoiseSchedule


@pytest.mark.parametrize(
    ("steps", "noisy", "sampled"),
    [
        (20, [0.2894737, 0.8709235, 1.1211450], [-0.5511230, 0.9999971, -0.9447222]),
        (100, [0.1610543, 0.8945441, 0.0413568], [-0.4286907, 0.5587909, -0.9800131]),
    ],
)
def test_noise_is_added_and_removed_as_before(
    steps: int, noisy: list[float], sampled: list[float]
) -> None:
    rng = torch.Generator().manual_seed(0)
    clean = torch.rand(16, 8, 3, generator=rng) * 2 - 1
    noise = torch.randn(16, 8, 3, generator=rng)
    level = torch.randint(steps, (16,), generator=rng)
    schedule = NoiseSchedule(steps)
    added = schedule.add_noise(clean, noise, level)
    torch.testing.assert_close(added[0, 0], torch.tensor(noisy), atol=1e-6, rtol=0)
    sample = schedule.sample(
        lambda value, levels: 0.7 * value + 0.01 * levels.float()[:, None, None],
        noise,
        torch.Generator().manual_seed(3),
    )
    torch.testing.assert_close(sample[0, 0], torch.tensor(sampled), atol=2e-5, rtol=0)
