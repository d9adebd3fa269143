"""Import a URDF as a robot folder; values that a URDF does not have are marked TODO."""

import json
import math
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from ....formats.core.atomic import atomic_folder
from ....formats.core.errors import FileFormatError, InputError, brief
from ....formats.untrusted.files import check_input
from ....formats.untrusted.limits import limits
from ..shapes import COLLISION_GROUP
from .facts import FACTS_NAME, NAME_PATTERN
from .model import MODEL_NAME, compile_model, load_model
from .reader import SOLE_SHAPES
from .safety import check_urdf, numbers_in

TODO = "TODO"
MESHES = (".stl", ".obj")  # formats that both URDF and MuJoCo use
TOUCH_M = 0.02  # feet reach at least this close to the lowest point of the robot


def import_urdf(urdf: Path, out: Path) -> tuple[list[str], list[str]]:
    """Write a URDF as a robot folder; nothing outside the URDF's folder is read.

    Returns:
        Each value that the user must add, as its file and field; notes on what was left out and
        what was assumed.

    Raises:
        FileFormatError: the file is no URDF, refers to files outside its folder or to collision
            meshes that MuJoCo cannot read, or MuJoCo rejects it.
        InputError: the folder's name is not a valid robot name.
    """
    if not NAME_PATTERN.fullmatch(out.name):
        raise InputError(f"{out}: names the robot; valid: letters, digits, - and _")
    root = check_urdf(urdf)
    with atomic_folder(out) as folder:
        notes = _take_meshes(urdf, root, folder)
        _make_free(urdf, root)
        draft = _Draft(urdf, root, _converted(urdf, root, folder))
        facts = draft.facts(out.name)
        (folder / FACTS_NAME).write_text("\n".join(_toml(facts)) + "\n")
        (folder / MODEL_NAME).write_text(draft.mjcf())
        compile_model(folder, load_model(folder, ()))
    todo = [f"{FACTS_NAME}: {field}" for field in _open(facts)]
    todo += [f"{MODEL_NAME}: actuator of {name}" for name in draft.joints]
    todo += ["policy.onnx and policy.json"] if draft.joints and not draft.wheels else []
    return todo, [*notes, *draft.notes]


def _take_meshes(urdf: Path, root: ElementTree.Element, folder: Path) -> list[str]:
    """Copy meshes into the new folder; visual shapes that MuJoCo cannot read are removed."""
    notes = []
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            name = mesh.get("filename", "")
            path = urdf.parent / name
            if path.is_file() and path.suffix.lower() in MESHES:
                check_input(path, root=urdf.parent, max_bytes=limits().robot_file_bytes)
                mesh.set("filename", "_".join(Path(name).parts))
                shutil.copyfile(path, folder / mesh.attrib["filename"])
                continue
            reason = f"mesh {brief(name)} is missing or no {' or '.join(MESHES)} file"
            if shape.tag == "collision":
                raise FileFormatError(urdf, f"collision {reason}")
            link.remove(shape)
            notes.append(f"left out: visual {reason}")
    return notes


def _make_free(urdf: Path, root: ElementTree.Element) -> None:
    """Attach the base link to the world by a floating joint, and set the compiler's options."""
    children = {child.get("link") for child in root.iterfind("joint/child")}
    bases = [n for link in root.findall("link") if (n := link.get("name", "")) not in children]
    anchored = [j for j in root.findall("joint") if j.find("parent[@link='world']") is not None]
    if len(bases) != 1 or len(anchored) != (bases[0] == "world"):
        raise FileFormatError(urdf, f"has {len(bases)} links that no joint has as child; valid: 1")
    if anchored:
        anchored[0].set("type", "floating")
    else:
        ElementTree.SubElement(root, "link", name="world")
        joint = ElementTree.SubElement(root, "joint", name="root", type="floating")
        ElementTree.SubElement(joint, "parent", link="world")
        ElementTree.SubElement(joint, "child", link=bases[0])
    options = {"strippath": "false", "fusestatic": "false", "discardvisual": "false"}
    ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", options)


def _converted(urdf: Path, root: ElementTree.Element, folder: Path) -> mujoco.MjSpec:
    """Return MuJoCo's model with a name for each geom; links without inertia have no mass."""
    path = folder / "import.urdf"
    path.write_bytes(ElementTree.tostring(root))
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        for body in spec.bodies:
            seen = any(not geom.contype for geom in body.geoms)
            for number, geom in enumerate(body.geoms):
                geom.name = f"{body.name}_{number}"
                geom.group = COLLISION_GROUP if geom.contype and seen else geom.group
                geom.mass = geom.mass if body.explicitinertial else 0.0
        spec.compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise FileFormatError(urdf, f"MuJoCo rejects it: {reason}") from error
    path.unlink()
    return spec


class _Draft:
    """Facts of an imported model in the pose of zeros."""

    def __init__(self, urdf: Path, root: ElementTree.Element, spec: mujoco.MjSpec):
        self.spec, self.notes, self.camera = spec, [], TODO
        self.model = model = spec.compile()
        self.data = data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        self.speeds = {
            joint.get("name"): speed
            for joint in root.findall("joint")
            for limit in joint.findall("limit")
            for speed in numbers_in(limit.get("velocity", ""))
            if speed > 0
        }
        turned = data.geom_xmat.reshape(-1, 3, 3)
        centers = data.geom_xpos + np.einsum("nij,nj->ni", turned, model.geom_aabb[:, :3])
        reach = np.einsum("nij,nj->ni", np.abs(turned), model.geom_aabb[:, 3:])
        solid = np.flatnonzero(model.geom_contype)
        if not len(solid):
            raise FileFormatError(urdf, "has no <collision> shape; valid: at least one")
        bottoms = (centers - reach)[:, 2]
        self.lowest_m = float(bottoms[solid].min())
        outer = np.abs((centers - data.xpos[1])[solid, :2]) + reach[solid, :2]
        self.radius_m = math.ceil(100 * np.hypot(*outer.T).max()) / 100
        touching = solid[bottoms[solid] < self.lowest_m + TOUCH_M]
        # The lowest geom of each body, in the order of bodies.
        by_height = sorted(touching, key=bottoms.__getitem__, reverse=True)
        lowest = {int(model.geom_bodyid[geom]): int(geom) for geom in by_height}
        self.soles = dict(sorted(lowest.items()))
        hinges = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE).tolist()
        self.wheels = [j for j in hinges if self._is_wheel(j)]
        if len({bool(data.xanchor[j, 1] > data.xpos[1, 1]) for j in self.wheels}) < 2:
            self.wheels = []  # not on both sides
        driven = [j for j in hinges if j in self.wheels or model.jnt_limited[j] or not self.wheels]
        self.joints = [model.joint(j).name for j in driven]
        passive = [model.joint(j).name for j in range(1, model.njnt) if j not in driven]
        self.notes += [f"joint {name!r} is left passive" for name in passive]
        cameras = [body for body in spec.bodies if "camera" in body.name.lower()]
        for body in [body for body in cameras if "optical" not in body.name.lower()][:1]:
            self.camera = "ego"
            body.add_camera(name="ego", quat=[0.5, 0.5, -0.5, -0.5])
            self.notes.append(f"the camera is in link {body.name!r} and looks along its +x")

    def _is_wheel(self, joint: int) -> bool:
        """Return whether a joint without limits on the chassis turns a foot about ±y."""
        weld, body = self.model.body_weldid, self.model.jnt_bodyid[joint]
        on_chassis = weld[self.model.body_parentid[body]] == 1
        foot = any(weld[sole] == body for sole in self.soles)
        sideways = abs(self.data.xaxis[joint, 1]) > 0.99
        return bool(not self.model.jnt_limited[joint] and on_chassis and foot and sideways)

    def mjcf(self) -> str:
        """Return model.xml; actuators are comments because a URDF has no gains."""
        for body, geom in self.soles.items():
            sole = self.spec.geom(self.model.geom(geom).name)
            sole.priority = 1
            if self.wheels and self.model.body_weldid[body] == 1:
                sole.condim = 1  # a caster slides
        for joint in self.wheels:
            wheel = self.spec.joint(self.model.joint(joint).name)
            wheel.axis = np.sign(self.data.xaxis[joint, 1]) * np.asarray(wheel.axis)
        self.spec.compile()
        root = ElementTree.fromstring(self.spec.to_xml())
        actuators = ElementTree.SubElement(root, "actuator")
        wheels = [self.model.joint(j).name for j in self.wheels]
        for name in self.joints:
            effort = self.model.jnt_actfrcrange[self.model.joint(name).id, 1]
            force = f"-{effort:g} {effort:g}" if effort > 0 else TODO
            kind = 'velocity kv="TODO"' if name in wheels else 'position kp="TODO" kv="TODO"'
            text = f' <{kind} joint="{name}" forcerange="{force}"/> '
            actuators.append(ElementTree.Comment(text))
        ElementTree.indent(root)
        return ElementTree.tostring(root, encoding="unicode") + "\n"

    def facts(self, name: str) -> dict[str, Any]:
        """Return the content of robot.toml; values that a URDF does not give are TODO."""
        model, data, walks = self.model, self.data, not self.wheels
        names = [model.joint(j).name for j in self.wheels]
        ranges = {joint: model.joint(joint).range for joint in self.joints}
        poses = {n: TODO if walks or low * high > 0 else 0.0 for n, (low, high) in ranges.items()}
        facts: dict[str, Any] = {"name": name, "footprint_radius_m": self.radius_m}
        facts |= {"action_scale_rad": TODO} if walks and self.joints else {}
        facts["joints"] = [{"name": n, "default_rad": pose} for n, pose in poses.items()]
        facts["feet"] = []
        for body, geom in self.soles.items():
            sole = model.geom(geom).name
            if mujoco.mjtGeom(int(model.geom_type[geom])) not in SOLE_SHAPES:
                self.notes.append(f"geom {sole!r} touches the floor, but is no sphere or cylinder")
                sole = TODO
            facts["feet"].append({"name": model.body(body).name, "soles": [sole]})
        com_m = float(data.subtree_com[1, 2]) - self.lowest_m
        facts["camera"] = {"name": self.camera}
        facts["fall"] = {"com_to_foot_m": TODO if walks else round(com_m / 2, 3)}
        commands: dict[str, Any] = {"vx_m_s": TODO, "vy_m_s": TODO, "yaw_rad_s": TODO}
        facts["command_limits"] = commands
        if walks:
            return facts
        y_m = data.xanchor[self.wheels, 1] - data.xpos[1, 1]
        radius_m = round(float(data.xanchor[self.wheels, 2].mean()) - self.lowest_m, 5)
        track_m = round(float(y_m[y_m > 0].mean() - y_m[y_m <= 0].mean()), 5)
        facts["drive"] = {
            "left": [n for n, y in zip(names, y_m, strict=True) if y > 0],
            "right": [n for n, y in zip(names, y_m, strict=True) if y <= 0],
            "wheel_radius_m": radius_m,
            "track_m": track_m,
        }
        commands["vy_m_s"] = [0.0, 0.0]
        for key, arm_m in (("vx_m_s", 1.0), ("yaw_rad_s", track_m / 2)):
            if all(n in self.speeds for n in names):
                top = round(min(self.speeds[n] for n in names) * radius_m / arm_m, 3)
                commands[key] = [-top, top]
        return facts


def _toml(facts: dict[str, Any]) -> Iterator[str]:
    """Yield the lines of a TOML file of values, then tables and lists of tables."""
    tables = {key: v for key, v in facts.items() if isinstance(v, dict) or (v and _listed(v))}
    yield from (f"{key} = {json.dumps(v)}" for key, v in facts.items() if key not in tables)
    for key, value in tables.items():
        for table in [value] if isinstance(value, dict) else value:
            yield from ("", f"[{key}]" if isinstance(value, dict) else f"[[{key}]]", *_toml(table))


def _listed(value: Any) -> bool:
    return isinstance(value, list) and isinstance(value[0], dict)


def _open(value: Any, field: str = "") -> Iterator[str]:
    """Yield the fields of robot.toml that are TODO; tables of a list go by their names."""
    if isinstance(value, dict):
        for key, child in value.items():
            yield from _open(child, f"{field}.{key}".lstrip("."))
    elif isinstance(value, list):
        for child in value:
            yield from _open(child, f"{field}.{child['name']}" if _listed([child]) else field)
    elif value == TODO:
        yield field
