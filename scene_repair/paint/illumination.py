"""Split a floor's colours into illumination (low frequencies) and pattern (the rest)."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from ...formats.core.arrays import F32, Array, Mask
from .pattern_search import COARSE, blocks, masked, reduced

# Colours are compared as logarithms, in which light is a sum; black is kept finite.
BLACK = np.float32(0.05)
# Light is a Gaussian mean of known floor; further away wider means take over, and at last the mean
# of all, which weigh little where narrower ones know something.
SIGMAS_M = (0.3, 0.8, 2.4)
WEIGHTS = (1.0, 3e-2, 1e-3)
MEAN_WEIGHT = 1e-6
# It varies slowly, and is estimated for blocks of so many pixels.
BLOCK_PX = COARSE**2


@dataclass(frozen=True)
class Split:
    """Both parts as logarithms (H, W, 3); their sum is the image."""

    light: F32
    pattern: F32

    def joined(self, pattern: F32, where: Mask) -> F32:
        """Return colours (N, 3) in 0–1 of a pattern under this illumination at the given pixels."""
        return np.clip(np.exp(self.light[where] + pattern[where]) - BLACK, 0.0, 1.0)


def split_light(image: F32, valid: Mask, plain: Mask, texel_m: float) -> Split:
    """Split an image (H, W, 3) in 0–1 with pixels of `texel_m` into illumination and pattern.

    Light is estimated from `plain` (H, W) pixels; where nothing is `valid` there is no pattern.
    """
    tone = image + BLACK
    np.log(tone, out=tone)
    share, mean = reduced(plain, tone)
    share, total = blocks(share), blocks(mean * share[..., None])
    overall = total.sum(axis=(0, 1)) / max(float(share.sum()), 1e-6)
    weight = np.full(share.shape, MEAN_WEIGHT)
    light = np.tile(MEAN_WEIGHT * overall.astype(np.float64), (*share.shape, 1))
    for sigma_m, strength in zip(SIGMAS_M, WEIGHTS, strict=True):
        sigma = sigma_m / texel_m / BLOCK_PX
        weight += strength * blurred(share, sigma)
        light += strength * blurred(total, sigma)
    light /= weight[..., None]
    # From blocks to pixels, clamped at the borders.
    size = (light.shape[1] * BLOCK_PX, light.shape[0] * BLOCK_PX)
    whole = cv2.resize(light.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    rest = valid.shape[0] - size[1], valid.shape[1] - size[0]
    wide = np.pad(np.asarray(whole, np.float32), ((0, rest[0]), (0, rest[1]), (0, 0)), mode="edge")
    tone -= wide
    return Split(wide, masked(tone, valid))


def blurred(image: F32, sigma: float) -> Array:
    """Return the zero-padded Gaussian mean (H, W[, C]); float64, as its far tails count."""
    axes = (sigma, sigma, 0)[: image.ndim]
    return ndimage.gaussian_filter(image.astype(np.float64), axes, mode="constant", truncate=3.0)
