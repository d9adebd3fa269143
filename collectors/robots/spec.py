"""A robot as one frozen record, and the physics options that every model with a robot shares."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

from ...formats.core.arrays import Array
from .parts import (
    CameraMount,
    CommandLimits,
    FallThresholds,
    Foot,
    JointFacts,
    StepRhythm,
    WheelDrive,
)

TIMESTEP_S = 0.005  # 200 Hz, as VLN-PE
POLICY_DECIMATION = 4  # physics steps per policy step: 50 Hz


def apply_physics_options(spec: mujoco.MjSpec) -> None:
    """Set the options that a robot's policy was trained with on the root spec of a model.

    `attach` does not copy options to the parent, so code that builds a scene around a robot calls
    this on the scene's own spec.
    """
    spec.option.timestep = TIMESTEP_S
    # The servos' damping is stiff at 5 ms; implicit integration keeps it stable.
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    # Elliptic cones halve the speed; pyramids let a loaded foot creep by about 1 cm/s at most.
    spec.option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    spec.option.impratio = 1.0
    spec.option.iterations = 30
    spec.option.ls_iterations = 20


@dataclass(frozen=True, kw_only=True)
class RobotSpec:
    """Facts of one robot, and the function that builds its model.

    Attributes:
        title: name for people, e.g. in the report.
        mass_kg: total mass [kg].
        joints: actuated joints; those that the policy controls come first, in its order.
        policy_joints: number of joints that the policy controls; the others follow the gait's
            reference motion.
        action_scale_rad: joint target = default + scale × policy action.
        root_body, root_joint: names of the floating base and of its free joint.
        feet: the feet or wheels that it stands on.
        base_height_m: height of the base frame above the floor when it stands settled.
        spawn_height_m: height of the base frame above the floor at which the default pose just
            touches it.
        footprint_radius_m: radius of the disc around the base that planners keep free.
        sources: where the facts come from, one line each.
        build: function that returns a new `MjSpec` of the robot alone.
        drive: the wheels of a robot on wheels; None for one that walks.
        rhythm: how a user's own robot steps, to train a gait for it; None if it does not say.
        folder: folder of a user's own robot; None for a built-in one.
        content_sha256: digest of that folder's files; empty for a built-in robot.
    """

    name: str
    title: str
    mass_kg: float
    joints: tuple[JointFacts, ...]
    root_body: str
    feet: tuple[Foot, ...]
    base_height_m: float
    spawn_height_m: float
    footprint_radius_m: float
    camera: CameraMount
    fall: FallThresholds
    command_limits: CommandLimits
    sources: tuple[str, ...]
    build: "Callable[[RobotSpec], mujoco.MjSpec]" = field(repr=False, compare=False)
    policy_joints: int = 0
    action_scale_rad: float = 0.0
    root_joint: str = "root"
    drive: WheelDrive | None = None
    rhythm: StepRhythm | None = None
    folder: Path | None = None
    content_sha256: str = ""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the actuated joints; those of the policy come first."""
        return tuple(joint.name for joint in self.joints)

    @property
    def policy_joint_names(self) -> tuple[str, ...]:
        """Names of the joints that the policy controls, in its order."""
        return self.joint_names[: self.policy_joints]

    @property
    def foot_names(self) -> tuple[str, ...]:
        """Names of the feet, in order."""
        return tuple(foot.name for foot in self.feet)

    @property
    def leans(self) -> bool:
        """Whether its trunk pitches along the slope of stairs, as it does on more than two feet."""
        return len(self.feet) > 2

    @property
    def default_joint_rad(self) -> Array:
        """(J,) default joint positions [rad]."""
        return np.array([joint.default_rad for joint in self.joints])

    def spec(self) -> mujoco.MjSpec:
        """Return a new, attachable spec of the robot alone, with its base at the origin."""
        return self.build(self)

    def build_model(self, floor: bool = True) -> mujoco.MjModel:
        """Compile the robot alone, on an infinite plane at z = 0 unless `floor` is False."""
        spec = self.spec()
        apply_physics_options(spec)
        spec.body(self.root_body).pos = [0.0, 0.0, self.spawn_height_m]
        if floor:
            spec.worldbody.add_geom(
                name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0]
            )
        return spec.compile()

    def physics_hash(self) -> str:
        """Return a SHA-256 over the dynamics: options, bodies, joints, servos, contacts.

        Colours, cameras and visual shapes are left out, so that a policy stays valid when only the
        robot's looks change. So is what none of our robots has: springs, excluded contacts,
        meshes, equalities, tendons. Values are rounded to six significant digits, so that another
        compiler's last bits do not change the hash.
        """
        model = self.build_model(floor=False)
        colliding = model.geom_contype + model.geom_conaffinity > 0
        parts = {
            **{key: getattr(model.opt, key) for key in _OPTION_FIELDS},
            **{key: getattr(model, key) for key in _DYNAMIC_FIELDS},
            **{key: getattr(model, key)[colliding] for key in _COLLISION_FIELDS},
        }
        digest = hashlib.sha256("/".join(self.joint_names).encode())
        for key, value in parts.items():
            text = ",".join(f"{number:.6g}" for number in np.ravel(value) + 0.0)
            digest.update(f"{key}={text};".encode())
        return digest.hexdigest()


_OPTION_FIELDS = ("timestep", "integrator", "cone", "impratio")
_DYNAMIC_FIELDS = (
    "body_parentid",
    "body_pos",
    "body_quat",
    "body_mass",
    "body_ipos",
    "body_iquat",
    "body_inertia",
    "jnt_type",
    "jnt_pos",
    "jnt_axis",
    "jnt_range",
    "dof_armature",
    "dof_damping",
    "dof_frictionloss",
    "actuator_gainprm",
    "actuator_biasprm",
    "actuator_forcerange",
    "actuator_gear",
)
_COLLISION_FIELDS = (
    "geom_bodyid",
    "geom_type",
    "geom_size",
    "geom_pos",
    "geom_quat",
    "geom_friction",
    "geom_solref",
    "geom_solimp",
    "geom_priority",
    "geom_margin",
)
