"""Staircases between levels, as a repair records them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ..core.arrays import Array, Mask
from ..core.frames import in_plan_frame


@dataclass(frozen=True)
class Staircase:
    """A staircase from one level to another.

    Attributes:
        levels: the two levels that it joins, lower first.
        line_world_m: (K, 3) middle line going up [m]: the floor before the first riser, the foot,
            the ends of flights and the corners on landings, the head, the floor behind it.
        width_m: least width of its flights.
        riser_m: highest riser.
        going_m: least horizontal distance from one riser to the next.
        problem: why nobody walks it, as in "is steep: risers up to 25 cm"; empty if it is
            climbable. Only climbable staircases have a sheet of their own.
    """

    levels: tuple[int, int]
    line_world_m: Array
    width_m: float
    riser_m: float
    going_m: float
    problem: str = ""

    def as_json(self) -> dict[str, Any]:
        """Return JSON values, the inverse of `from_json`."""
        line = np.round(self.line_world_m, 4).tolist()
        return {**vars(self), "levels": list(self.levels), "line_world_m": line}

    @staticmethod
    def from_json(values: Mapping[str, Any], levels: int) -> "Staircase":
        """Return the staircase that JSON values describe, in a scene of so many levels.

        Raises:
            KeyError, TypeError, ValueError: values are missing or invalid.
        """
        lower, upper = values["levels"]
        if not 0 <= lower < upper < levels:
            valid = f"0 … {levels - 1}, lower first"
            raise ValueError(f"staircase between levels {lower} and {upper}; valid: {valid}")
        line = np.array(values["line_world_m"], dtype=np.float64)
        if line.ndim != 2 or line.shape[1] != 3 or len(line) < 2 or not np.isfinite(line).all():
            raise ValueError(f"staircase with a middle line of shape {line.shape}; valid: (K, 3)")
        width, riser, going = (float(values[k]) for k in ("width_m", "riser_m", "going_m"))
        return Staircase((lower, upper), line, width, riser, going, str(values["problem"]))


@dataclass(frozen=True)
class Treads:
    """Treads and landings of a staircase, and the floor's edge at its head, as boxes.

    Attributes:
        center_m: (n, 3) float64 world [m], in order of walking up; the last is the floor's edge.
        half_m: (n, 3) float64 half sides [m]: along the box's own x and y, and z.
        yaw_rad: (n,) float64 direction of the box's x in the world; on flights it points up them.
    """

    center_m: Array
    half_m: Array
    yaw_rad: Array

    def __post_init__(self) -> None:
        count = len(self.yaw_rad)
        for name, shape in (
            ("center_m", (count, 3)),
            ("half_m", (count, 3)),
            ("yaw_rad", (count,)),
        ):
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} of shape {getattr(self, name).shape}; valid: {shape}")

    @property
    def top_m(self) -> Array:
        """Heights (n,) [m] of their upper faces."""
        return self.center_m[:, 2] + self.half_m[:, 2]

    @property
    def without_edge(self) -> "Treads":
        """The treads and landings alone."""
        return Treads(self.center_m[:-1], self.half_m[:-1], self.yaw_rad[:-1])

    def holds(self, xy_m: Array, more_m: float = 0.0) -> Mask:
        """Return which boxes hold which points in plan, or pass them within `more_m` [m].

        Where two boxes touch, a point lies in the upper one.

        Args:
            xy_m: (..., 2) world [m].

        Returns:
            (n, ...) bool.
        """
        result = np.empty((len(self.yaw_rad), *xy_m.shape[:-1]), dtype=bool)
        for k, (center, half) in enumerate(zip(self.center_m, self.half_m, strict=True)):
            own = in_plan_frame(xy_m, center[:2], self.yaw_rad[k])
            reach = half[:2] + more_m
            result[k] = np.all((own >= -reach) & (own < reach), axis=-1)
        return result

    @staticmethod
    def joined(parts: Sequence["Treads"]) -> "Treads":
        """Return the boxes of all `parts`, of which there is at least one."""
        return Treads(
            *(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Treads))
        )
