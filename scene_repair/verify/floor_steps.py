"""Find height steps of a written floor, and whether scan or repair introduced them."""

from typing import Any

import numpy as np

from ...formats.core.arrays import Mask
from ..grid.morphology import grow, grown_window, label, windows
from .probe_rays import Probes

STEP_M = 0.015
# Steps this near to each other are one; the scan's own heights are compared this far around it.
JOIN_M, AROUND_M = 0.04, 0.25
# The scan has a step itself if its heights there span this share of it.
SHARE = 0.8
MAX_LISTED = 200


def find_steps(probes: Probes, walked: Mask) -> list[dict[str, Any]]:
    """Return steps over 1.5 cm between neighbouring probes where a robot walks, highest first.

    A step is the `scan`'s own if scanned heights around it differ by as much (thresholds, sunken
    areas, rugs), and the `repair`'s if only added floor has it.
    """
    height = np.where(walked, probes.height_m, np.float32(np.nan))
    rise = np.zeros(height.shape, dtype=np.float32)
    with np.errstate(invalid="ignore"):
        for axis in (0, 1):
            between = np.nan_to_num(np.abs(np.diff(height, axis=axis)))
            for ends in ((0, 1), (1, 0)):
                sides = [ends if k == axis else (0, 0) for k in (0, 1)]
                rise = np.maximum(rise, np.pad(between, sides))
    high = rise > STEP_M
    if not high.any():
        return []
    cell_m = probes.grid.cell_m
    parts, _ = label(grow(high, max(round(JOIN_M / cell_m / 2), 1)), diagonal=True)
    around = round(AROUND_M / cell_m)
    steps = []
    for number, window in enumerate(windows(parts), start=1):
        selected = (parts[window] == number) & high[window]
        top = float(rise[window][selected].max())
        wide = grown_window(window, around, high.shape)
        scanned = height[wide][~probes.added[wide]]
        scanned = scanned[np.isfinite(scanned)]
        own = len(scanned) > 0 and float(np.ptp(scanned)) >= SHARE * top
        touched = bool(probes.added[window][selected].any())
        index = np.argwhere(selected) + np.array([window[0].start, window[1].start])
        low, most = (probes.grid.center_of(at) for at in (index.min(axis=0), index.max(axis=0)))
        steps.append(
            {
                "lower_xy_m": [round(float(v), 3) for v in low],
                "upper_xy_m": [round(float(v), 3) for v in most],
                "height_m": round(top, 4),
                "origin": "repair" if touched and not own else "scan",
            }
        )
    return sorted(steps, key=lambda step: (step["origin"], -step["height_m"]))
