"""Footholds on stairs: how a gait's reference follows the ground that a height scan shows.

On level ground it adds nothing. On stairs the trunk is to pitch along the slope, or, on two legs,
to stay upright and sink a little; every foot is put where the ground is flat, at the height of the
ground there, and swings over the edge in between.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ....formats.core.arrays import Array
from ...physics.ground import Ground
from .footholds import FootingTables
from .gait import RATE_HZ, GaitClock

# Powers of a foot's shift forward and up in the polynomials that turn it into joint offsets.
POWERS = tuple((i, n - i) for n in range(1, 6) for i in range(n + 1))
# Heights of a scan that differ by more are no level ground, whatever the camera's noise.
UNEVEN_M = 0.045
BEARING = 0.7  # share of a sole that must not stand out over an edge
SLOPE_S = 0.16  # time constant of the slope under a robot
SERVO_S = 0.05  # and of joints that follow their targets


@dataclass(frozen=True)
class Footing:
    """A height scan around a robot, and what its gait makes of it.

    Attributes:
        scan_x_m, scan_y_m: where the ground is looked at, forward and left of the base, level and
            turned with its heading: evenly spaced rows, and columns, of which every foot has one.
        base_height_m: of the base above the ground.
        step_m: how high the gait lifts its feet on level ground.
        clearance_m: how high they shall pass over an edge.
        leg_m: height of the legs' upper joints over the feet, and their least and greatest length.
        reach_rad: F × `POWERS` rows of J joint offsets [rad per m, per m², …].
        bear_rad: the same, how much farther servos of the legs that bear the robot must aim; none
            where empty.
        lean: share of the slope by which the trunk pitches.
        crouch_m: how far the base sinks on a slope of 1.
        sole_m: half the length of its soles, whose middle gaits put below the body; 0 of a point
            foot.
    """

    scan_x_m: tuple[float, ...]
    scan_y_m: tuple[float, ...]
    base_height_m: float
    step_m: float
    clearance_m: float
    leg_m: tuple[float, float, float]
    reach_rad: tuple[tuple[float, ...], ...]
    bear_rad: tuple[tuple[float, ...], ...] = ()
    lean: float = 1.0
    crouch_m: float = 0.0
    sole_m: float = 0.0

    @classmethod
    def of(cls, values: dict[str, Any]) -> Footing:
        """Return the footing of a card's values.

        Raises:
            KeyError, TypeError: a value is missing, or another one there.
        """
        values = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
        for name in ("reach_rad", "bear_rad"):
            values[name] = tuple(tuple(row) for row in values.get(name, ()))
        return cls(**values)

    @property
    def points_m(self) -> Array:
        """(columns × rows, 2) points of the scan in the order of an observation."""
        y, x = np.meshgrid(self.scan_y_m, self.scan_x_m, indexing="ij")
        return np.column_stack([x.ravel(), y.ravel()])

    @property
    def width(self) -> int:
        """Number of values that an observation has of the ground: its slope and the scan."""
        return 1 + len(self.scan_x_m) * len(self.scan_y_m)

    @cached_property
    def _points(self) -> Array:
        return self.points_m

    def scan(self, ground: Ground, pose: Array) -> Array:
        """Return heights (N, columns, rows) under robots at poses (N, 3): x, y [m], heading."""
        cosine, sine = np.cos(pose[:, 2:]), np.sin(pose[:, 2:])
        x, y = self._points.T
        world = np.stack(
            [pose[:, :1] + cosine * x - sine * y, pose[:, 1:2] + sine * x + cosine * y], axis=-1
        )
        return ground.at(world).reshape(len(pose), len(self.scan_y_m), len(self.scan_x_m))

    def tables(self, gait: GaitClock) -> FootingTables:
        """Return the footing as numbers for kernels."""
        x, y = self.scan_x_m, np.array(self.scan_y_m)
        reach = np.array(self.reach_rad).reshape(len(gait.foot_offsets), len(POWERS), -1)
        spacing = (x[-1] - x[0]) / (len(x) - 1)
        return FootingTables(
            x[0],
            spacing,
            self.base_height_m,
            self.step_m,
            self.clearance_m,
            0.25 / gait.frequency_hz,
            1.0 / (RATE_HZ * SLOPE_S),
            1.0 / (RATE_HZ * SERVO_S),
            *self.leg_m,
            self.lean,
            self.crouch_m,
            int(np.rint(self.sole_m / spacing)),
            BEARING if self.sole_m else 1.0,
            columns=np.array([int(np.abs(y - foot).argmin()) for _, foot in gait.foot_xy_m]),
            reach=reach,
            bear=np.array(self.bear_rad).reshape(reach.shape) if self.bear_rad else 0.0 * reach,
            powers=np.array(POWERS),
        )
