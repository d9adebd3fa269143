"""Humanoids as tables: links on hinges, limbs, soles, and the model built from them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any

import mujoco
import numpy as np

from .parts import WALKING, Foot, JointFacts
from .shapes import (
    Vector,
    add_camera,
    add_collision,
    add_imu,
    add_joint,
    add_servo,
    add_touch,
    set_inertia,
    start_robot,
)
from .spec import RobotSpec

SIDES = (("left", 1.0), ("right", -1.0))
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
# Collision capsule of a limb: link without its side, radius [m], both ends of the axis [m].
Limb = tuple[str, float, Vector, Vector]
Bodies = Mapping[str, mujoco.MjsBody]


TORQUE_SOURCE = (
    "torque falls off from 60 % of the speed limit on: Unitree's torque-speed curves of such "
    "motors have their knee at 55–77 % of the no-load speed (unitree_rl_lab)"
)
INERTIA_SOURCE = "link inertias: uniform boxes of the links' outer size with the published masses"
UNITREE_SOURCES = (
    "PD gains and default legs: common practice of velocity-tracking policies on this robot",
    TORQUE_SOURCE,
    INERTIA_SOURCE,
)


@dataclass(frozen=True, kw_only=True)
class Servo:
    """A motor with its gears and position servo; see `JointFacts`.

    Attributes:
        armature_kg_m2: rotor inertia seen through the gears [kg·m²].
    """

    kp: float
    kd: float
    torque_nm: float
    speed_rad_s: float
    armature_kg_m2: float


@dataclass(frozen=True)
class Link:
    """One body that hangs on its parent by one hinge.

    Attributes:
        parent: name of the parent body.
        axis: axis of the hinge: x, y or z of the body's frame.
        servo: drives the hinge.
        default_rad, range_rad: default position and limits of the hinge [rad].
        mass_kg: mass [kg].
        box_m: full sides of the uniform box that has the link's inertia [m].
        position_m: (x, y, z) of the hinge in the parent's frame [m].
        center_m: (x, y, z) of the centre of mass in the link's own frame [m].
        pitch_deg: fixed rotation of the link's frame about y [deg].
        joint_name: name of the hinge; `<name>_joint` when empty.
    """

    name: str
    parent: str
    axis: str
    servo: Servo
    default_rad: float
    range_rad: tuple[float, float]
    _: KW_ONLY
    mass_kg: float
    box_m: tuple[float, float, float]
    position_m: tuple[float, float, float]
    center_m: tuple[float, float, float]
    pitch_deg: float = 0.0
    joint_name: str = ""

    @property
    def joint(self) -> JointFacts:
        """Limits, default pose and servo of the hinge."""
        servo = self.servo
        return JointFacts(
            self.joint_name or f"{self.name}_joint",
            self.default_rad,
            self.range_rad,
            kp=servo.kp,
            kd=servo.kd,
            torque_nm=servo.torque_nm,
            speed_rad_s=servo.speed_rad_s,
        )


@dataclass(frozen=True, kw_only=True)
class Soles:
    """The ball contacts below both feet; positions are those of the left foot.

    Attributes:
        link: link that carries them, without its side, e.g. `ankle` for `left_ankle`.
        radius_m: radius of each ball [m].
        z_m: height of the balls' centres in the link's frame [m].
        xy_m: (x, y) of each ball [m] by name.
        touch_x_m, touch_m: centre and half sides of the touch sensor's box around them [m].
    """

    link: str
    radius_m: float
    z_m: float
    xy_m: Mapping[str, tuple[float, float]]
    touch_x_m: float
    touch_m: tuple[float, float, float]

    @property
    def feet(self) -> tuple[Foot, ...]:
        """Both feet, by the names that `add` gives."""
        return tuple(
            Foot(f"{side}_foot", tuple(f"{side}_{ball}" for ball in self.xy_m)) for side, _ in SIDES
        )

    def add(self, spec: mujoco.MjSpec, bodies: Bodies, side: str, sign: float) -> None:
        """Add one foot's balls and its touch sensor; `sign` is 1 for left, −1 for right."""
        body = bodies[f"{side}_{self.link}"]
        for ball, (x, y) in self.xy_m.items():
            place = (x, sign * y, self.z_m)
            add_collision(
                body, f"{side}_{ball}", "sphere", (self.radius_m,), position=place, sole=True
            )
        add_touch(spec, body, f"{side}_foot", (self.touch_x_m, 0.0, self.z_m), self.touch_m)


@dataclass(frozen=True, kw_only=True)
class Humanoid:
    """Parts of a humanoid's model; the free body is called `pelvis`.

    Attributes:
        pelvis_kg, pelvis_center_m, pelvis_box_m: mass [kg], centre of mass [m] and full sides [m]
            of the box that has the pelvis's inertia.
        links: all other bodies in the order of the joints, parents first.
        frictionloss_nm: dry friction of each joint [Nm].
        trunk: function that adds the collision shapes of pelvis, torso and head.
        limbs: collision capsules of arms and legs.
        dress: function that adds the visual shapes to the bodies.
    """

    pelvis_kg: float
    pelvis_center_m: Vector
    pelvis_box_m: Vector
    links: tuple[Link, ...]
    frictionloss_nm: float
    trunk: Callable[[Bodies], None]
    limbs: Sequence[Limb]
    soles: Soles
    dress: Callable[[Bodies], None]

    def robot(self, **facts: Any) -> RobotSpec:
        """Return the robot with this body; `facts` are the other fields of `RobotSpec`."""
        return RobotSpec(
            mass_kg=self.pelvis_kg + sum(link.mass_kg for link in self.links),
            joints=tuple(link.joint for link in self.links),
            action_scale_rad=0.25,
            root_body="pelvis",
            feet=self.soles.feet,
            command_limits=WALKING,
            build=self.build,
            **facts,
        )

    def build(self, robot: RobotSpec) -> mujoco.MjSpec:
        """Return the robot alone: collision and visual shapes, servos, sensors, ego camera."""
        spec, pelvis = start_robot(robot)
        set_inertia(pelvis, self.pelvis_kg, center_m=self.pelvis_center_m, box_m=self.pelvis_box_m)
        bodies = add_links(pelvis, self.links, self.frictionloss_nm)
        self.trunk(bodies)
        for side, sign in SIDES:
            for link, radius_m, begin, end in self.limbs:
                name = f"{side}_{link}"
                add_collision(bodies[name], name, "capsule", (radius_m,), ends=(begin, end))
            self.soles.add(spec, bodies, side, sign)
        self.dress(bodies)
        add_imu(spec, pelvis)
        add_camera(bodies[robot.camera.body], robot.camera)
        for joint in robot.joints:
            add_servo(spec, joint)
        return spec


def both_sides(
    *, left_leg: Sequence[Link], middle: Sequence[Link], left_arm: Sequence[Link]
) -> tuple[Link, ...]:
    """Return all links in the order of the joints: legs first, because policies move those."""
    right_leg, right_arm = map(mirrored, left_leg), map(mirrored, left_arm)
    return (*left_leg, *right_leg, *middle, *left_arm, *right_arm)


def mirrored(link: Link) -> Link:
    """Return the mirror image of a link of the left side, whose names begin with `left_`."""

    def swap(name: str) -> str:
        return name.replace("left_", "right_", 1)

    x, y, z = link.position_m
    cx, cy, cz = link.center_m
    default_rad, (low, high) = link.default_rad, link.range_rad
    if link.axis != "y":
        # A reflection of y reverses turns about x and z.
        default_rad, low, high = 0.0 - default_rad, -high, -low
    return replace(
        link,
        name=swap(link.name),
        parent=swap(link.parent),
        default_rad=default_rad,
        range_rad=(low, high),
        position_m=(x, -y, z),
        center_m=(cx, -cy, cz),
    )


def add_links(
    root: mujoco.MjsBody, links: Sequence[Link], frictionloss_nm: float
) -> dict[str, mujoco.MjsBody]:
    """Add bodies with inertia and hinges below `root`, and return all bodies by name."""
    bodies = {root.name: root}
    for link in links:
        body = bodies[link.parent].add_body(name=link.name, pos=list(link.position_m))
        if link.pitch_deg:
            quat = np.zeros(4)
            mujoco.mju_euler2Quat(quat, [0.0, np.deg2rad(link.pitch_deg), 0.0], "xyz")
            body.quat = quat.tolist()
        add_joint(
            body,
            link.joint,
            AXES[link.axis],
            armature_kg_m2=link.servo.armature_kg_m2,
            frictionloss_nm=frictionloss_nm,
        )
        set_inertia(body, link.mass_kg, center_m=link.center_m, box_m=link.box_m)
        bodies[link.name] = body
    return bodies
