"""A robot's model as URDF, for RViz and robot_state_publisher."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ...collectors.robots import RobotSpec
from ...formats.core.arrays import Floats
from ...formats.mcap.robot_links import CYLINDER, SPHERE, LinkShape
from .link_shapes import body_shapes

BASE_LINK = "base_link"
_TYPES = {mujoco.mjtJoint.mjJNT_HINGE: "revolute", mujoco.mjtJoint.mjJNT_SLIDE: "prismatic"}


def robot_urdf(robot: RobotSpec) -> str:
    """Return a robot's links, joints, inertias and visible shapes.

    Its base is `base_link`; joints have the model's names. Meshes are drawn as their bounding
    boxes, since a URDF holds no triangles, and ellipsoids likewise.

    Raises:
        ValueError: If the model has ball joints.
    """
    model = robot.build_model(floor=False)
    shapes = body_shapes(model)
    root = model.body(robot.root_body).id
    document = ET.Element("robot", name=robot.name)
    names = {root: BASE_LINK}
    # URDF's links lie at their joint, MuJoCo's bodies need not.
    shifts: dict[int, Floats] = {root: np.zeros(3)}
    for body in range(root, model.nbody):
        if model.body_rootid[body] != model.body_rootid[root]:
            continue
        if body != root:
            parent = names[int(model.body_parentid[body])]
            origin = model.body_pos[body] - shifts[int(model.body_parentid[body])]
            names[body] = model.body(body).name
            shifts[body] = _add_joints(document, model, body, parent, names[body], origin)
        _add_link(document, model, body, names[body], shifts[body], shapes.get(body, ()))
    ET.indent(document)
    return ET.tostring(document, encoding="unicode", xml_declaration=True)


def _add_joints(
    document: ET.Element,
    model: mujoco.MjModel,
    body: int,
    parent: str,
    child: str,
    origin_m: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Add what joins a body to its parent; return where its link lies in the body's frame [m]."""
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    quat = model.body_quat[body]
    if not count:
        _add_joint(document, f"{child}_fixed", "fixed", (parent, child), origin_m, quat)
        return np.zeros(3)
    at = np.zeros(3)
    turn = Rotation.from_quat(quat, scalar_first=True)
    for number in range(count):
        joint = first + number
        # Several joints of a body need links of no mass between them.
        last = number == count - 1
        link = child if last else f"{child}_{number}"
        if not last:
            ET.SubElement(document, "link", name=link)
        moved = model.jnt_pos[joint] - at
        place = origin_m + turn.apply(moved) if number == 0 else moved
        kind = _TYPES.get(mujoco.mjtJoint(model.jnt_type[joint]))
        if kind is None:
            raise ValueError(f"joint {model.joint(joint).name} is neither a hinge nor a slide")
        if not model.jnt_limited[joint]:
            kind = "continuous" if kind == "revolute" else kind
        name = model.joint(joint).name
        still = np.array([1.0, 0.0, 0.0, 0.0])
        element = _add_joint(
            document, name, kind, (parent, link), place, quat if number == 0 else still
        )
        ET.SubElement(element, "axis", xyz=_text(model.jnt_axis[joint]))
        low, high = model.jnt_range[joint] if model.jnt_limited[joint] else (-1e9, 1e9)
        limits = {"lower": f"{low:.9g}", "upper": f"{high:.9g}"} if kind != "continuous" else {}
        effort = _effort(model, joint)
        ET.SubElement(element, "limit", limits, effort=f"{effort:.9g}", velocity="1000")
        parent, at = link, model.jnt_pos[joint]
    return at


def _add_joint(
    document: ET.Element,
    name: str,
    kind: str,
    links: tuple[str, str],
    origin_m: NDArray[np.float64],
    quat_wxyz: NDArray[np.float64],
) -> ET.Element:
    joint = ET.SubElement(document, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=links[0])
    ET.SubElement(joint, "child", link=links[1])
    _add_origin(joint, origin_m, quat_wxyz)
    return joint


def _effort(model: mujoco.MjModel, joint: int) -> float:
    """Return the largest force or torque of a joint's servo; 0 where it has none."""
    driven = np.flatnonzero(
        (model.actuator_trnid[:, 0] == joint)
        & (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT)
    )
    return float(np.abs(model.actuator_forcerange[driven]).max(initial=0.0))


def _add_link(
    document: ET.Element,
    model: mujoco.MjModel,
    body: int,
    name: str,
    shift_m: Floats,
    shapes: Sequence[LinkShape],
) -> None:
    link = ET.SubElement(document, "link", name=name)
    if model.body_mass[body] > 0:
        inertial = ET.SubElement(link, "inertial")
        _add_origin(inertial, model.body_ipos[body] - shift_m, model.body_iquat[body])
        ET.SubElement(inertial, "mass", value=f"{model.body_mass[body]:.9g}")
        diagonal = zip(("ixx", "iyy", "izz"), model.body_inertia[body], strict=True)
        moments = {key: f"{value:.9g}" for key, value in diagonal}
        ET.SubElement(inertial, "inertia", moments, ixy="0", ixz="0", iyz="0")
    for number, shape in enumerate(shapes):
        visual = ET.SubElement(link, "visual")
        position, geometry, size = (
            shape.position_link_m - shift_m,
            ET.Element("geometry"),
            shape.size_m,
        )
        if shape.corners_m is not None:
            corners = shape.corners_m.reshape(-1, 3)
            low, high = corners.min(axis=0), corners.max(axis=0)
            turn = Rotation.from_quat(shape.quat_wxyz, scalar_first=True)
            position, size = position + turn.apply((low + high) / 2), high - low
        if shape.kind == CYLINDER:
            radius, length = f"{size[0] / 2:.9g}", f"{size[2]:.9g}"
            ET.SubElement(geometry, "cylinder", radius=radius, length=length)
        elif shape.kind == SPHERE and np.ptp(size) == 0:
            ET.SubElement(geometry, "sphere", radius=f"{size[0] / 2:.9g}")
        else:
            ET.SubElement(geometry, "box", size=_text(size))
        _add_origin(visual, position, shape.quat_wxyz)
        visual.append(geometry)
        material = ET.SubElement(visual, "material", name=f"{name}_{number}")
        ET.SubElement(material, "color", rgba=_text(np.array(shape.rgba)))


def _add_origin(
    element: ET.Element, position_m: NDArray[np.float64], quat_wxyz: NDArray[np.float64]
) -> None:
    angles = Rotation.from_quat(quat_wxyz, scalar_first=True).as_euler(
        "xyz", suppress_warnings=True
    )
    ET.SubElement(element, "origin", xyz=_text(position_m), rpy=_text(angles))


def _text(values: NDArray[np.float64]) -> str:
    return " ".join(f"{value:.9g}" for value in values)
