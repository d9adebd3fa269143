"""What the humanoids' models share: limbs on both sides, soles of four balls, sums over links."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import mujoco

from .links import Link, right_of
from .shapes import Vector, add_collision, add_touch
from .spec import Foot, JointFacts

SIDES = (("left", 1.0), ("right", -1.0))
# A limb's collision: part of the body, radius [m], both ends of the capsule's axis [m].
Limb = tuple[str, float, Vector, Vector]


@dataclass(frozen=True)
class Soles:
    """The ball contacts below both feet; positions are those of the left foot.

    Attributes:
        part: of the body that carries them, e.g. `ankle` of `left_ankle`.
        radius_m: of each ball.
        z_m: height of the balls' centres in the body's frame.
        xy_m: (x, y) of each ball by name.
        touch_x_m, touch_m: middle and half sides of the box that feels all of them.
    """

    part: str
    radius_m: float
    z_m: float
    xy_m: Mapping[str, tuple[float, float]]
    touch_x_m: float
    touch_m: tuple[float, float, float]

    @property
    def feet(self) -> tuple[Foot, ...]:
        """Both feet by the names that `add` gives."""
        return tuple(
            Foot(f"{side}_foot", tuple(f"{side}_{ball}" for ball in self.xy_m)) for side, _ in SIDES
        )

    def add(
        self, spec: mujoco.MjSpec, bodies: Mapping[str, mujoco.MjsBody], side: str, left: float
    ) -> None:
        """Add one foot's balls and its touch sensor; `left` is 1, or −1 for the mirror image."""
        body = bodies[f"{side}_{self.part}"]
        for ball, (x, y) in self.xy_m.items():
            place = (x, left * y, self.z_m)
            add_collision(
                body, f"{side}_{ball}", "sphere", (self.radius_m,), position=place, foot=True
            )
        add_touch(spec, body, f"{side}_foot", (self.touch_x_m, 0.0, self.z_m), self.touch_m)


def joint_of(
    name: str,
    default: float,
    low: float,
    high: float,
    kp: float,
    kd: float,
    torque: float,
    speed: float,
) -> JointFacts:
    """Facts of the joint of the link `name`, see `JointFacts`."""
    return JointFacts(f"{name}_joint", default, (low, high), kp, kd, torque, speed)


def both_sides(
    left_leg: Sequence[Link], middle: Sequence[Link], left_arm: Sequence[Link]
) -> tuple[Link, ...]:
    """All links in the order of the joints: legs first, because policies move those."""
    right_leg, right_arm = map(right_of, left_leg), map(right_of, left_arm)
    return (*left_leg, *right_leg, *middle, *left_arm, *right_arm)


def link_masses(root: str, root_kg: float, links: Iterable[Link]) -> Mapping[str, float]:
    """Mass of each body [kg] by name."""
    return MappingProxyType({root: root_kg, **{link.name: link.mass_kg for link in links}})


def add_limbs(bodies: Mapping[str, mujoco.MjsBody], side: str, limbs: Iterable[Limb]) -> None:
    """Give the bodies of one side the capsules they collide with."""
    for part, radius_m, begin, end in limbs:
        name = f"{side}_{part}"
        add_collision(bodies[name], name, "capsule", (radius_m,), ends=(begin, end))
