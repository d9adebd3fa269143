"""One robot on a floor, in MuJoCo and in Drake, behind the same few functions."""

from __future__ import annotations

import logging
from typing import Any, Protocol

import mujoco
import numpy as np

from ....formats.core.arrays import Array
from ....formats.core.errors import MissingExtraError
from ...robots import TIMESTEP_S, RobotHandles, RobotSpec, apply_physics_options
from .servo import Servos

BLOCK_M = 0.5  # side of a block of an uneven floor
# Of Drake in one physics step, for its hard contacts: at 4 the Go2 fell in 12 of 28 fast arcs, at 8
# and 16 in none.
SUBSTEPS = 8
# Drake has no dry friction in joints; this is one that a speed of 0.1 rad/s has nearly reached.
_FRICTION_SPEED_RAD_S = 0.1


class World(Protocol):
    """A robot in some engine.

    Attributes:
        data: its state in the layout of `RobotSpec.build_model`; read by a gait.
        handles: addresses in it.
    """

    data: mujoco.MjData
    handles: RobotHandles

    def advance(self, control: Array) -> None:
        """Simulate 20 ms; `control` (4, J) holds the joint targets [rad] of 5 ms each."""
        ...

    def kick(self, velocity_m_s: Array) -> None:
        """Add (2,) to the base's velocity in the world."""
        ...


class MujocoWorld:
    """The engine that gaits are trained in; satisfies `World`."""

    def __init__(self, robot: RobotSpec, heights_m: Array | None) -> None:
        """Build a flat floor, or blocks of heights (N, N) [m] around the origin."""
        spec = robot.spec()
        apply_physics_options(spec)
        box = mujoco.mjtGeom.mjGEOM_BOX
        for center, half in _boxes(heights_m):
            spec.worldbody.add_geom(type=box, pos=center, size=half)
        self._model = spec.compile()
        self.data = mujoco.MjData(self._model)
        self.handles = RobotHandles.find(robot, self._model)
        self.handles.spawn(self.data)

    def advance(self, control: Array) -> None:
        """See `World`."""
        for target in control:
            self.data.ctrl[self.handles.actuators] = target
            mujoco.mj_step(self._model, self.data)

    def kick(self, velocity_m_s: Array) -> None:
        """See `World`."""
        v = self.handles.root_dof
        self.data.qvel[v : v + 2] += velocity_m_s


class DrakeWorld:
    """The same bodies, rotors, contacts and servos in Drake; satisfies `World`.

    Drake reads our MJCF without its actuators and sensors. Torques come from `Servos`, every
    0.6 ms.
    """

    def __init__(self, robot: RobotSpec, heights_m: Array | None) -> None:
        """Build a flat floor, or blocks of heights (N, N) [m] around the origin.

        Raises:
            MissingExtraError: drake is not installed.
        """
        try:
            from pydrake.geometry import Box
            from pydrake.math import RigidTransform
            from pydrake.multibody.parsing import Parser
            from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
            from pydrake.systems.analysis import Simulator
            from pydrake.systems.framework import DiagramBuilder
        except ImportError:
            raise MissingExtraError("a second physics engine", "drake") from None
        logging.getLogger("drake").setLevel(logging.ERROR)
        model = robot.build_model()
        self.data, self._servos = mujoco.MjData(model), Servos(robot)
        self.handles = h = RobotHandles.find(robot, model)
        self._friction_nm = model.dof_frictionloss[h.joint_dof]
        builder: Any = DiagramBuilder()
        self._step_s = TIMESTEP_S / SUBSTEPS
        self._plant, _ = AddMultibodyPlantSceneGraph(builder, self._step_s)
        Parser(self._plant).AddModelsFromString(_bodies_alone(robot), "xml")
        for name, armature in zip(robot.joint_names, model.dof_armature[h.joint_dof], strict=True):
            motor = self._plant.AddJointActuator(name, self._plant.GetJointByName(name))
            motor.set_default_rotor_inertia(float(armature))
            motor.set_default_gear_ratio(1.0)
        # Drake takes the mean of both friction coefficients, MuJoCo here that of the sole.
        friction = CoulombFriction(*2 * [float(model.geom_friction[h.sole_geoms[0, 0], 0])])
        for k, (center, half) in enumerate(_boxes(heights_m)):
            self._plant.RegisterCollisionGeometry(
                self._plant.world_body(),
                RigidTransform(np.array(center)),
                Box(*(2.0 * np.array(half))),
                f"floor_{k}",
                friction,
            )
        self._plant.Finalize()
        joints = [self._plant.GetJointByName(name) for name in robot.joint_names]
        self._q = np.array([joint.position_start() for joint in joints])
        self._v = np.array([joint.velocity_start() for joint in joints])
        self._u = np.array(
            [self._plant.GetJointActuatorByName(n).input_start() for n in robot.joint_names]
        )
        self._simulator: Any = Simulator(builder.Build())
        self._context = self._plant.GetMyMutableContextFromRoot(
            self._simulator.get_mutable_context()
        )
        h.spawn(self.data)
        positions, root = np.zeros(self._plant.num_positions()), h.root_qpos
        positions[:4], positions[4:7] = self.data.qpos[root + 3 : root + 7], self.data.qpos[:3]
        positions[self._q] = self.data.qpos[h.joint_qpos]
        self._plant.SetPositions(self._context, positions)
        self._simulator.Initialize()

    def advance(self, control: Array) -> None:
        """See `World`."""
        for target in np.repeat(control, SUBSTEPS, axis=0):
            joint_rad = self._plant.GetPositions(self._context)[self._q]
            joint_rad_s = self._plant.GetVelocities(self._context)[self._v]
            torque = np.zeros(len(self._u))
            torque[self._u] = self._servos.torque(
                target, joint_rad, joint_rad_s
            ) - self._friction_nm * np.tanh(joint_rad_s / _FRICTION_SPEED_RAD_S)
            self._plant.get_actuation_input_port().FixValue(self._context, torque)
            self._simulator.AdvanceTo(self._context.get_time() + self._step_s)
        self._mirror()

    def kick(self, velocity_m_s: Array) -> None:
        """See `World`."""
        velocities = self._plant.GetVelocities(self._context)
        velocities[3:5] += velocity_m_s
        self._plant.SetVelocities(self._context, velocities)
        self._mirror()

    def _mirror(self) -> None:
        """Write Drake's state to `data`: the base's turn rate is in the world there."""
        positions = self._plant.GetPositions(self._context)
        velocities = self._plant.GetVelocities(self._context)
        data, h = self.data, self.handles
        q, v = h.root_qpos, h.root_dof
        data.qpos[q : q + 3], data.qpos[q + 3 : q + 7] = positions[4:7], positions[:4]
        axes = np.zeros(9)
        mujoco.mju_quat2Mat(axes, positions[:4])
        data.qvel[v : v + 3] = velocities[3:6]
        data.qvel[v + 3 : v + 6] = axes.reshape(3, 3).T @ velocities[:3]
        data.qpos[h.joint_qpos], data.qvel[h.joint_dof] = positions[self._q], velocities[self._v]


def _bodies_alone(robot: RobotSpec) -> str:
    """Return the MJCF of a robot's bodies, joints and collision shapes."""
    spec = robot.spec()
    spec.compile()
    for parts in (spec.actuators, spec.sensors, spec.cameras, spec.sites):
        for part in list(parts):
            spec.delete(part)
    for geom in list(spec.geoms):
        if not geom.contype and not geom.conaffinity:
            spec.delete(geom)
    for joint in spec.joints:
        joint.frictionloss = 0.0
    # Drake overlooks what an empty class inherits.
    for part in [*spec.joints, *spec.geoms]:
        part.classname = spec.default
    return spec.to_xml()


def _boxes(heights_m: Array | None) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Return centres and half sizes [m] of the boxes of a floor."""
    if heights_m is None:
        return [((0.0, 0.0, -0.5), (50.0, 50.0, 0.5))]
    middle, half = 0.5 * (len(heights_m) - 1), 0.5 * BLOCK_M
    return [
        (
            (BLOCK_M * (column - middle), BLOCK_M * (row - middle), 0.5 * (height - 0.5)),
            (half, half, 0.5 * (height + 0.5)),
        )
        for (row, column), height in np.ndenumerate(heights_m)
    ]
