"""Denoising diffusion (DDPM; Ho et al., 2020) with the squared-cosine schedule."""

import math
from collections.abc import Callable

import torch
from torch import Tensor, nn


class NoiseSchedule(nn.Module):
    """Adds and removes noise of values in −1 … 1.

    Attributes:
        steps: number of levels of noise, K.
        beta: (K,) variance that each level adds.
        kept: (K,) part of the clean value's variance that is left at each level.
    """

    beta: Tensor
    kept: Tensor

    def __init__(self, steps: int):
        """Prepare the schedule of Nichol and Dhariwal, 2021, as diffusion policies use it."""
        super().__init__()
        self.steps = steps

        def kept(part: float) -> float:
            return math.cos((part + 0.008) / 1.008 * math.pi / 2) ** 2

        beta = [min(1 - kept((k + 1) / steps) / kept(k / steps), 0.999) for k in range(steps)]
        alpha = 1 - torch.tensor(beta, dtype=torch.float64)
        # Not part of a checkpoint: they follow from the number of steps.
        self.register_buffer("beta", torch.tensor(beta, dtype=torch.float32), persistent=False)
        self.register_buffer("kept", alpha.cumprod(0).float(), persistent=False)

    def add_noise(self, clean: Tensor, noise: Tensor, level: Tensor) -> Tensor:
        """Return `clean` (N, …) with `noise` of the levels (N,) in 0 … K − 1."""
        kept = self.kept[level].reshape(-1, *[1] * (clean.ndim - 1))
        return kept.sqrt() * clean + (1 - kept).sqrt() * noise

    def sample(
        self, predict: Callable[[Tensor, Tensor], Tensor], noise: Tensor, rng: torch.Generator
    ) -> Tensor:
        """Remove the noise of `noise` (N, …) step by step.

        Args:
            predict: returns the noise in (N, …) at the levels (N,).
            noise: standard normal values to start from.
            rng: on the CPU, of the noise that each step but the last adds.
        """
        value = noise
        for k in reversed(range(self.steps)):
            level = torch.full((len(value),), k, device=value.device)
            kept, beta = self.kept[k], self.beta[k]
            before = self.kept[k - 1] if k else torch.ones_like(kept)
            guess = (value - (1 - kept).sqrt() * predict(value, level)) / kept.sqrt()
            guess = guess.clamp(-1.0, 1.0)
            value = (before.sqrt() * beta * guess + (1 - beta).sqrt() * (1 - before) * value) / (
                1 - kept
            )
            if k:
                spread = ((1 - before) / (1 - kept) * beta).sqrt()
                added = torch.randn(value.shape, generator=rng).to(value.device)
                value = value + spread * added
        return value
