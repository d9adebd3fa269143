"""model.xml, the MJCF of a user's own robot: sensors are added and it is checked against the facts.

Everything that affects motion stays as the user wrote it; only names and sensors are added.
"""

from collections.abc import Iterable
from pathlib import Path

import mujoco
import numpy as np

from ....formats.core.arrays import Array
from ....formats.core.errors import FileFormatError
from ..parts import Foot
from .facts import FACTS_NAME

MODEL_NAME = "model.xml"
ROOT_JOINT = "root"
_FREE = mujoco.mjtJoint.mjJNT_FREE


def load_model(folder: Path, feet: Iterable[Foot]) -> mujoco.MjSpec:
    """Return the robot alone, its base at the origin, with actuator names, IMU and touch sensors.

    Raises:
        FileFormatError: model.xml is missing or no MJCF, does not contain exactly one free body,
            or lacks a foot's soles.
    """
    path = folder / MODEL_NAME
    if not path.is_file():
        raise FileFormatError(path, "missing; every robot folder must have an MJCF model")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise _refused(path, error) from error
    for key in list(spec.keys):
        spec.delete(key)
    root = _root(path, spec)
    root.pos = [0.0, 0.0, 0.0]
    root.joints[0].name = root.joints[0].name or ROOT_JOINT
    driven = [a for a in spec.actuators if a.trntype == mujoco.mjtTrn.mjTRN_JOINT]
    targets = [actuator.target for actuator in driven]
    for actuator, target in zip(driven, targets, strict=True):
        if targets.count(target) > 1:
            raise FileFormatError(path, f"joint {target!r} has more than one actuator; valid: one")
        actuator.name = target
    _add_sensors(path, spec, root, feet)
    return spec


def compile_model(folder: Path, spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile the spec from `load_model`.

    Raises:
        FileFormatError: MuJoCo rejects the model.
    """
    try:
        return spec.compile()
    except ValueError as error:
        raise _refused(folder / MODEL_NAME, error) from error


def _refused(path: Path, error: ValueError) -> FileFormatError:
    return FileFormatError(path, f"MuJoCo rejects it: {' '.join(str(error).split())}")


def _root(path: Path, spec: mujoco.MjSpec) -> mujoco.MjsBody:
    if spec.worldbody.geoms:
        name = spec.worldbody.geoms[0].name or "without a name"
        raise FileFormatError(
            path, f"the worldbody has a geom ({name}); valid: the robot alone, without a floor"
        )
    bodies = list(spec.worldbody.bodies)
    if len(bodies) != 1:
        raise FileFormatError(
            path, f"the worldbody has {len(bodies)} bodies; valid: one, the robot"
        )
    root = bodies[0]
    if not root.name:
        raise FileFormatError(path, "the robot's base body has no name; give it one")
    kinds = [joint.type for joint in root.joints]
    if kinds != [_FREE] or sum(joint.type == _FREE for joint in spec.joints) != 1:
        raise FileFormatError(
            path,
            f"body {root.name!r} must be free; valid: a <freejoint/> in it alone",
        )
    return root


def _add_sensors(
    path: Path, spec: mujoco.MjSpec, root: mujoco.MjsBody, feet: Iterable[Foot]
) -> None:
    """Add what is missing of `gyro`, `accelerometer` and the feet's touch sensors."""
    sensors = {sensor.name for sensor in spec.sensors}

    def add(name: str, kind: mujoco.mjtSensor, site: str) -> None:
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=site)

    imu = {
        "gyro": mujoco.mjtSensor.mjSENS_GYRO,
        "accelerometer": mujoco.mjtSensor.mjSENS_ACCELEROMETER,
    }
    if imu.keys() - sensors:
        root.add_site(name="vlnpe_imu", group=4)
    for name, kind in imu.items():
        if name not in sensors:
            add(name, kind, "vlnpe_imu")
    geoms = {geom.name: geom for geom in spec.geoms}
    places: dict[str, tuple[Array, float]] = {}
    for foot in feet:
        for sole in foot.soles:
            if sole not in geoms:
                raise FileFormatError(
                    path,
                    f"no geom {sole!r}, which {FACTS_NAME} lists in feet.{foot.name}.soles; "
                    f"valid: {joined(geoms)}",
                )
        touch = f"{foot.name}_touch"
        if touch in sensors:
            continue
        first = geoms[foot.soles[0]]
        if any(geoms[sole].parent != first.parent for sole in foot.soles):
            raise FileFormatError(path, f"the soles of foot {foot.name!r} are on different bodies")
        places = places or _places(path, spec)
        center = np.mean([places[sole][0] for sole in foot.soles], axis=0)
        reach = max(
            float(np.linalg.norm(places[sole][0] - center)) + places[sole][1] for sole in foot.soles
        )
        first.parent.add_site(
            name=touch, pos=center, size=[1.05 * reach + 0.002, 0.0, 0.0], group=4
        )
        add(touch, mujoco.mjtSensor.mjSENS_TOUCH, touch)


def _places(path: Path, spec: mujoco.MjSpec) -> dict[str, tuple[Array, float]]:
    """Return the position in its body [m] and the bounding radius [m] of every geom by name.

    The model is compiled because frames and `fromto` are resolved by the compiler.
    """
    model = compile_model(path.parent, spec)
    return {
        model.geom(i).name: (model.geom_pos[i].copy(), float(model.geom_rbound[i]))
        for i in range(model.ngeom)
    }


def joined(names: Iterable[str]) -> str:
    """Return names for a message, sorted and separated by commas."""
    return ", ".join(sorted(name for name in names if name))
