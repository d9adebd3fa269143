"""Facts read from the compiled model of a user's own robot, and its checks against robot.toml."""

import math
from pathlib import Path

import mujoco
import numpy as np

from ....formats.core.errors import FileFormatError
from ..handles import sole_radius_m
from ..parts import FULL_TORQUE_SPEED, CameraMount, JointFacts
from ..shapes import POSITION_INPUT
from .facts import FACTS_NAME, FolderFacts
from .model import MODEL_NAME, joined

SOLE_SHAPES = (
    mujoco.mjtGeom.mjGEOM_SPHERE,
    mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    mujoco.mjtGeom.mjGEOM_CYLINDER,
)


class ModelReader:
    """Reads facts from the compiled model; every error names file, field and valid values."""

    def __init__(self, folder: Path, model: mujoco.MjModel, facts: FolderFacts):
        self.model, self.facts = model, facts
        self.path, self.facts_path = folder / MODEL_NAME, folder / FACTS_NAME
        self.data = mujoco.MjData(model)
        names = [model.joint(i).name for i in range(model.njnt)]
        for name, default in facts.joints:
            if name not in names:
                raise self._wrong(
                    f"joints.{name}", f"is not in {MODEL_NAME}; valid: {joined(names)}"
                )
            self.data.qpos[model.joint(name).qposadr[0]] = default
        mujoco.mj_kinematics(model, self.data)
        mujoco.mj_camlight(model, self.data)

    def _wrong(self, field: str, reason: str) -> FileFormatError:
        return FileFormatError(self.facts_path, f"{field} {reason}")

    def joints(self) -> tuple[JointFacts, ...]:
        """Return limits and servos of the joints, in the order of robot.toml.

        Raises:
            FileFormatError: a joint lacks a suitable servo, or an unlisted joint has one.
        """
        model, facts = self.model, self.facts
        wheels = (
            {} if facts.drive is None else dict.fromkeys((*facts.drive.left, *facts.drive.right))
        )
        listed = [name for name, _ in facts.joints]
        for name in wheels:
            if name not in listed:
                raise self._wrong("drive", f"contains {name!r}; valid: {joined(listed)}")
        for i in range(model.nu):
            if model.actuator(i).name not in listed:
                raise FileFormatError(
                    self.path,
                    f"the joint of actuator {model.actuator(i).name!r} is not listed in joints "
                    f"of {FACTS_NAME}; valid: {joined(listed)}",
                )
        return tuple(self._joint(name, value, name in wheels) for name, value in facts.joints)

    def _joint(self, name: str, default_rad: float, wheel: bool) -> JointFacts:
        model, joint = self.model, self.model.joint(name)
        if joint.type[0] != mujoco.mjtJoint.mjJNT_HINGE:
            raise FileFormatError(self.path, f"joint {name!r} is not a hinge; valid: hinges")
        limits = (-math.inf, math.inf)
        if model.jnt_limited[joint.id]:
            limits = float(joint.range[0]), float(joint.range[1])
        if not limits[0] <= default_rad <= limits[1]:
            raise self._wrong(
                f"joints.{name}.default_rad",
                f"is {default_rad:g}; valid: {limits[0]:.4g} … {limits[1]:.4g}",
            )
        driven = [model.actuator(i).name for i in range(model.nu)]
        if name not in driven:
            raise FileFormatError(self.path, f"joint {name!r} has no actuator; valid: one")
        servo = model.actuator(name)
        gain, bias, speed = servo.gainprm, servo.biasprm, math.inf
        simple = not servo.dyntype[0] and not servo.gaintype[0] and servo.biastype[0] == 1
        simple = simple and servo.gear[0] == 1.0 and gain[0] > 0
        if wheel:
            fits = simple and bias[1] == 0.0 and bias[2] == -gain[0]
            kind, kp, kd = "<velocity kv=…> of gear 1, for a wheel", 0.0, gain[0]
        elif servo.gaintype[0] == mujoco.mjtGain.mjGAIN_DCMOTOR:
            # R, K, temperature, reference, kp, ki, kd, greatest voltage; see `shapes.add_servo`.
            fits = model.actuator_ctrlspec[servo.id] == POSITION_INPUT and servo.gear[0] == 1.0
            fits = fits and model.actuator_actnum[servo.id] == 0 and gain[4] > 0
            kind, kp, kd = '<dcmotor input="pos"> of gear 1 without states', gain[4], gain[6]
            speed = float(gain[7] / gain[1]) if gain[7] > 0 else math.inf
        else:
            fits = simple and bias[1] == -gain[0]
            kind, kp, kd = "<position kp=… kv=…> of gear 1", gain[0], -bias[2]
        if not fits:
            raise FileFormatError(self.path, f"the actuator of joint {name!r} must be a {kind}")
        x, y, z = self.data.xaxis[joint.id].tolist()
        if wheel and y < 0.99:
            raise FileFormatError(
                self.path,
                f"wheel {name!r} turns about ({x:.2g}, {y:.2g}, {z:.2g}) of the base; valid: "
                "(0, 1, 0), which drives forward",
            )
        limit = math.inf
        if servo.forcelimited[0]:
            limit = float(servo.forcerange[1])
        if model.jnt_actfrclimited[joint.id]:
            limit = min(limit, float(model.jnt_actfrcrange[joint.id, 1]))
        if not math.isfinite(limit):
            raise FileFormatError(
                self.path,
                f"the actuator of joint {name!r} has no forcerange; add it [Nm]",
            )
        share = FULL_TORQUE_SPEED
        if math.isfinite(speed):
            # At what speed the supply voltage still drives the limiting torque through R.
            share = round(max(0.0, 1.0 - float(gain[0] / (gain[1] * gain[7])) * limit), 9)
        return JointFacts(
            name,
            default_rad,
            limits,
            kp=float(kp),
            kd=float(kd),
            torque_nm=limit,
            speed_rad_s=speed,
            full_torque_speed=share,
        )

    def check_feet(self) -> None:
        """Raise FileFormatError if the soles have a wrong shape or number."""
        feet = self.facts.feet
        if not feet or len({len(foot.soles) for foot in feet}) != 1:
            raise self._wrong("feet", "valid: one or more, each with the same number of soles")
        for foot in feet:
            for sole in foot.soles:
                geom = self.model.geom(sole)
                shape = mujoco.mjtGeom(int(geom.type[0]))
                if shape not in SOLE_SHAPES:
                    kind = shape.name.removeprefix("mjGEOM_").lower()
                    raise self._wrong(
                        f"feet.{foot.name}.soles",
                        f"contains {sole!r}, a {kind}; valid: spheres (for wheels also cylinders "
                        "and ellipsoids)",
                    )
                if not (geom.contype[0] or geom.conaffinity[0]):
                    raise self._wrong(
                        f"feet.{foot.name}.soles",
                        f"contains {sole!r}, which does not collide; set contype or conaffinity",
                    )

    def standing_m(self, root_body: str) -> float:
        """Return the height of the base above the lowest sole in the default pose [m]."""
        ids = np.array([self.model.geom(s).id for foot in self.facts.feet for s in foot.soles])
        lowest = self.data.geom_xpos[ids, 2] - sole_radius_m(self.model, ids)
        return float(self.data.body(root_body).xpos[2] - lowest.min())

    def camera(self) -> CameraMount:
        """Return the mount of the ego camera.

        Raises:
            FileFormatError: the model has no camera of that name.
        """
        model, name = self.model, self.facts.camera_name
        names = [model.camera(i).name for i in range(model.ncam)]
        if name not in names:
            valid = joined(names) or f"add a <camera> to {MODEL_NAME}"
            raise self._wrong("camera.name", f"is {name!r}; valid: {valid}")
        camera = model.camera(name)
        down = min(max(float(self.data.cam_xmat[camera.id, 8]), -1.0), 1.0)
        return CameraMount(
            name=name,
            body=model.body(int(model.cam_bodyid[camera.id])).name,
            position_body_m=(float(camera.pos[0]), float(camera.pos[1]), float(camera.pos[2])),
            # A camera looks along its −z: if its +z points up, it looks down.
            pitch_down_deg=round(math.degrees(math.asin(down)), 6),
            model=self.facts.camera,
        )
