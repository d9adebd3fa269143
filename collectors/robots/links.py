"""Robots as tables of links: what a humanoid's model is written in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from .shapes import Vector, add_joint, set_inertia
from .spec import JointFacts

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class Link:
    """One body that hangs on its parent by one hinge.

    Attributes:
        name: of the body; its joint is `<name>_joint`.
        parent: name of the body it hangs on.
        position_m: (x, y, z) of its joint in the parent's frame [m].
        axis: of the joint: x, y or z of the body's frame.
        mass_kg: mass of the link.
        center_m: (x, y, z) of its centre of mass in its own frame [m].
        box_m: full sides of the uniform box that has its inertia [m].
        facts: limits, default pose and servo of the joint.
        armature_kg_m2: rotor inertia seen through the gears.
        pitch_deg: fixed rotation of the link's frame about y [deg].
    """

    name: str
    parent: str
    position_m: tuple[float, float, float]
    axis: str
    mass_kg: float
    center_m: tuple[float, float, float]
    box_m: tuple[float, float, float]
    facts: JointFacts
    armature_kg_m2: float
    pitch_deg: float = 0.0


def right_of(link: Link) -> Link:
    """The mirror image of a link of the left side, whose names begin with `left_`."""

    def swap(name: str) -> str:
        return name.replace("left_", "right_", 1)

    x, y, z = link.position_m
    cx, cy, cz = link.center_m
    facts, low, high = link.facts, *link.facts.range_rad
    if link.axis != "y":
        # A reflection of y reverses turns about x and z.
        facts = replace(facts, default_rad=0.0 - facts.default_rad, range_rad=(-high, -low))
    return replace(
        link,
        name=swap(link.name),
        parent=swap(link.parent),
        position_m=(x, -y, z),
        center_m=(cx, -cy, cz),
        facts=replace(facts, name=swap(facts.name)),
    )


def add_links(
    root: mujoco.MjsBody, links: Sequence[Link], frictionloss_nm: float
) -> dict[str, mujoco.MjsBody]:
    """Add bodies with inertia and joints below `root`; parents come before their children.

    Returns:
        All bodies by name, the root among them.
    """
    bodies = {root.name: root}
    for link in links:
        body = bodies[link.parent].add_body(name=link.name, pos=list(link.position_m))
        if link.pitch_deg:
            body.quat = _pitched(link.pitch_deg)
        add_joint(body, link.facts, AXES[link.axis], link.armature_kg_m2, frictionloss_nm)
        set_inertia(body, link.mass_kg, link.center_m, link.box_m)
        bodies[link.name] = body
    return bodies


def _pitched(pitch_deg: float) -> Vector:
    quat = np.zeros(4)
    mujoco.mju_euler2Quat(quat, [0.0, np.deg2rad(pitch_deg), 0.0], "xyz")
    return quat.tolist()
