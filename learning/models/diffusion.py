"""Denoising diffusion (DDPM; Ho et al., 2020) with the squared-cosine schedule, by diffusers."""

from collections.abc import Callable

import torch
from torch import Tensor


class NoiseSchedule:
    """Adds and removes noise of values in −1 … 1, as diffusion policies do.

    Attributes:
        steps: number of levels of noise, K.
    """

    def __init__(self, steps: int):
        """Prepare the schedule of Nichol and Dhariwal, 2021."""
        # Late, because it takes seconds, and other models do not need it.
        from diffusers.schedulers.scheduling_ddpm import DDPMScheduler

        self.steps = steps
        self._scheduler = DDPMScheduler(steps, beta_schedule="squaredcos_cap_v2")
        self._scheduler.set_timesteps(steps)

    def add_noise(self, clean: Tensor, noise: Tensor, level: Tensor) -> Tensor:
        """Return `clean` (N, …) with `noise` of the levels (N,) in 0 … K − 1."""
        return self._scheduler.add_noise(clean, noise, level)  # type: ignore[arg-type]

    def sample(
        self, predict: Callable[[Tensor, Tensor], Tensor], noise: Tensor, rng: torch.Generator
    ) -> Tensor:
        """Remove the noise of `noise` (N, …) step by step.

        Args:
            predict: Return the noise in (N, …) at the levels (N,).
            noise: Standard normal values to start from.
            rng: Generator on the CPU of the noise that each step but the last adds.
        """
        value = noise
        for k in reversed(range(self.steps)):
            level = torch.full((len(value),), k, device=value.device)
            step = self._scheduler.step(predict(value, level), k, value, rng, return_dict=False)
            value = step[0]
        return value
