"""Export a robot as a folder, to start a user's own robot from."""

import json
import math
import re
import shutil
import tomllib
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from ....formats.core.arrays import Floats
from ....formats.core.atomic import atomic_folder, write_json
from ....formats.core.errors import FileFormatError, InputError
from ..spec import RobotSpec
from .facts import FACTS_NAME, NAME_PATTERN
from .load import CARD_NAME, load_robot_folder
from .model import MODEL_NAME


def export_robot(robot: RobotSpec, out: Path, policy: tuple[Path, Path] | None) -> RobotSpec:
    """Write `robot` as a folder with identical dynamics; the folder's name becomes the robot's.

    Args:
        out: output folder; replaced as a whole.
        policy: network and card of a robot that walks.

    Returns:
        The robot as read back from the folder.

    Raises:
        InputError: the folder's name is not a valid robot name.
        FileFormatError: robot.toml has the name where it is not found.
    """
    if not NAME_PATTERN.fullmatch(out.name):
        raise InputError(
            f"{out}: the folder's name becomes the robot's; valid: letters, digits, - and _"
        )
    with atomic_folder(out) as folder:
        if robot.folder is not None:
            shutil.copytree(robot.folder, folder, dirs_exist_ok=True)
            (folder / FACTS_NAME).write_text(_renamed(robot.folder / FACTS_NAME, out.name))
        else:
            (folder / MODEL_NAME).write_text(exact_mjcf(robot.spec()))
            (folder / FACTS_NAME).write_text(facts_text(robot, out.name))
        if policy is not None:
            shutil.copyfile(policy[0], folder / f"policy{policy[0].suffix}")
            card = json.loads(policy[1].read_text())
            write_json(folder / CARD_NAME, {**card, "robot": out.name})
    return load_robot_folder(out)


def _renamed(facts: Path, name: str) -> str:
    """Return the text of a robot.toml with another name, and all else as it is.

    Raises:
        FileFormatError: the first line that looks like the name's is not.
    """
    text = facts.read_text()
    changed = re.sub(r"(?m)^name\s*=.*$", f"name = {json.dumps(name)}", text, count=1)
    try:
        read = tomllib.loads(changed).get("name")
    except tomllib.TOMLDecodeError:
        read = None
    if read != name:
        raise FileFormatError(facts, 'its name is not found; valid: a first line `name = "…"`')
    return changed


def facts_text(robot: RobotSpec, name: str) -> str:
    """Return a robot's facts as the text of a commented robot.toml."""

    def numbers(values: Sequence[float]) -> str:
        return "[" + ", ".join(f"{v!r}" for v in values) + "]"

    def texts(values: Sequence[str]) -> str:
        return json.dumps(list(values), ensure_ascii=False)

    camera, fall, limits = robot.camera, robot.fall, robot.command_limits
    lines = [
        f"name = {json.dumps(name)}",
        f"title = {json.dumps(robot.title, ensure_ascii=False)}",
        f"footprint_radius_m = {robot.footprint_radius_m!r}  # disc that planners keep free",
        f"base_height_m = {robot.base_height_m!r}  # of the base above the floor, standing settled",
        f"spawn_height_m = {robot.spawn_height_m!r}  # at which the default pose touches the floor",
    ]
    if robot.policy_joints:
        lines += [
            f"policy_joints = {robot.policy_joints}  # number of joints that the policy controls",
            f"action_scale_rad = {robot.action_scale_rad!r}  # target = default + scale × action",
        ]
    lines += ["sources = [", *(f"  {json.dumps(s, ensure_ascii=False)}," for s in robot.sources)]
    lines += ["]", "joints = ["]
    lines += [
        f'  {{ name = "{joint.name}", default_rad = {joint.default_rad!r} }},'
        for joint in robot.joints
    ]
    lines.append("]")
    for foot in robot.feet:
        lines += ["", "[[feet]]", f'name = "{foot.name}"', f"soles = {texts(foot.soles)}"]
    lines += [
        "",
        "[camera]",
        f'name = "{camera.name}"  # of a camera in model.xml',
        f"width_px = {camera.model.width_px}",
        f"height_px = {camera.model.height_px}",
        f"hfov_deg = {camera.model.hfov_deg!r}",
        "",
        "[fall]  # the robot has fallen when it leans or sinks beyond these",
        f"com_to_foot_m = {fall.com_to_foot_m!r}",
        f"roll_deg = {_degrees(fall.roll_rad)!r}",
        f"pitch_deg = {_degrees(fall.pitch_rad)!r}",
        "",
        "[command_limits]",
        f"vx_m_s = {numbers(limits.vx_m_s)}",
        f"vy_m_s = {numbers(limits.vy_m_s)}",
        f"yaw_rad_s = {numbers(limits.yaw_rad_s)}",
    ]
    if robot.drive is not None:
        drive = robot.drive
        lines += [
            "",
            "[drive]",
            f"left = {texts(drive.left)}",
            f"right = {texts(drive.right)}",
            f"wheel_radius_m = {drive.wheel_radius_m!r}",
            f"track_m = {drive.track_m!r}",
            f"ramp_m_s2 = {drive.ramp_m_s2!r}",
            f"ramp_rad_s2 = {drive.ramp_rad_s2!r}",
        ]
    return "\n".join(lines) + "\n"


def _degrees(angle_rad: float) -> float:
    """Return the shortest decimal number of degrees that converts back to exactly this angle."""
    exact = math.degrees(angle_rad)
    tries = (float(f"{exact:.{digits}g}") for digits in range(2, 17))
    return next((d for d in tries if math.radians(d) == angle_rad), exact)


def exact_mjcf(spec: mujoco.MjSpec) -> str:
    """Return the MJCF of a spec in full precision; MuJoCo's own writer keeps six digits."""
    model = spec.compile()
    root = ElementTree.fromstring(spec.to_xml())
    for tag, columns in _columns(model).items():
        elements: list[ElementTree.Element | None] = [*root.iter(tag)]
        if tag == "inertial":  # not every body has one
            elements = [body.find(tag) for body in root.iter("body")]
        for row, element in enumerate(elements):
            if element is not None:
                _write_exactly(element, {key: array[row] for key, array in columns.items()})
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _write_exactly(element: ElementTree.Element, exact: dict[str, Floats]) -> None:
    """Replace the rounded numbers in an element's attributes by the exact ones."""
    for key, values in exact.items():
        if key not in element.attrib:
            continue
        printed = np.array(element.attrib[key].split(), dtype=np.float64)
        numbers = np.atleast_1d(values)[: len(printed)]
        if np.allclose(printed, numbers, rtol=1e-5, atol=1e-9):
            element.attrib[key] = " ".join(_shortest(v) for v in numbers)


def _shortest(value: np.floating) -> str:
    """Return the shortest text that reads back as the same number, e.g. 0.5, 1e-05, 3."""
    return np.format_float_positional(value, trim="-") if abs(value) > 1e-4 else repr(float(value))


def _columns(model: mujoco.MjModel) -> dict[str, dict[str, Floats]]:
    """Return arrays of the compiled model by MJCF tag and attribute, one row for each element."""
    m, joints = model, model.jnt_dofadr
    return {
        "body": {"pos": m.body_pos[1:], "quat": m.body_quat[1:]},
        "inertial": {
            "pos": m.body_ipos[1:],
            "quat": m.body_iquat[1:],
            "mass": m.body_mass[1:],
            "diaginertia": m.body_inertia[1:],
        },
        "joint": {
            "pos": m.jnt_pos,
            "axis": m.jnt_axis,
            "range": m.jnt_range,
            "armature": m.dof_armature[joints],
            "frictionloss": m.dof_frictionloss[joints],
            "damping": m.dof_damping[joints],
        },
        "geom": {
            "pos": m.geom_pos,
            "quat": m.geom_quat,
            "size": m.geom_size,
            "friction": m.geom_friction,
            "rgba": m.geom_rgba,
        },
        "site": {"pos": m.site_pos, "quat": m.site_quat, "size": m.site_size},
        "camera": {"pos": m.cam_pos, "quat": m.cam_quat, "fovy": m.cam_fovy},
        "general": {
            "gainprm": m.actuator_gainprm,
            "biasprm": m.actuator_biasprm,
            "forcerange": m.actuator_forcerange,
        },
    }
