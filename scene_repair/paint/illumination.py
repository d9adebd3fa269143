"""Split a floor's colours into illumination (low frequencies) and pattern (the rest)."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..grid.morphology import Mask
from .pattern_search import COARSE, blocks, masked, reduced

Image32 = NDArray[np.float32]

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

    light: Image32
    pattern: Image32

    def joined(self, pattern: Image32, where: Mask) -> Image32:
        """Return colours (N, 3) in 0–1 of a pattern under this illumination at the given pixels."""
        return np.clip(np.exp(self.light[where] + pattern[where]) - BLACK, 0.0, 1.0)


def split_light(image: Image32, known: Mask, plain: Mask, texel_m: float) -> Split:
    """Split an image into illumination and pattern.

    Args:
        image: (H, W, 3) in 0–1.
        known: (H, W) where it shows anything; elsewhere the pattern is none.
        plain: (H, W) what light is estimated from.
        texel_m: side of a pixel.
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
    wide = _enlarged(light.astype(np.float32), known.shape)
    tone -= wide
    return Split(wide, masked(tone, known))


def blurred(image: Image32, sigma: float) -> NDArray[np.float64]:
    """Return the zero-padded Gaussian mean (H, W[, C]); float64, as its far tails count."""
    axes = (sigma, sigma, 0)[: image.ndim]
    return ndimage.gaussian_filter(image.astype(np.float64), axes, mode="constant", truncate=3.0)


def _enlarged(light: Image32, shape: tuple[int, ...]) -> Image32:
    """Interpolate block values to pixels, clamped at the borders."""
    rows, columns = light.shape[:2]
    size = (columns * BLOCK_PX, rows * BLOCK_PX)
    whole = np.asarray(cv2.resize(light, size, interpolation=cv2.INTER_LINEAR), dtype=np.float32)
    rest = shape[0] - whole.shape[0], shape[1] - whole.shape[1]
    return np.pad(whole, ((0, rest[0]), (0, rest[1]), (0, 0)), mode="edge")
