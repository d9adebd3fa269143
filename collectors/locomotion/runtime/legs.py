"""Kinematics of legs: where the feet are, how they move and what they carry, from the joints."""

from typing import NamedTuple

import mujoco
import numpy as np

from ....formats.core.arrays import I64, Array
from ....formats.core.errors import InputError
from ....formats.core.frames import quat_to_matrix
from ....formats.process.kernel import called, kernel
from ...robots import RobotHandles

GRAVITY_M_S2 = 9.81


class Legs(NamedTuple):
    """The chains of bodies from a robot's base to its feet, as arrays for kernels.

    Attributes:
        joint: (F, L) index of each body's hinge among the robot's joints; −1 for a fixed body, −2
            beyond the end of a shorter chain.
        place: (F, L, 3) position of each body in its parent [m].
        turn: (F, L, 3, 3) its rotation there.
        axis, anchor: (F, L, 3) axis of its hinge and a point on it [m], in the body's frame.
        mass: (F, L) of each body [kg].
        center: (F, L, 3) its centre of mass in its own frame [m].
        soles: (F, S, 3) centres of the spheres in each chain's last body [m].
        radius: (F, S) their radii [m].
        weight: (1,) of the whole robot [N].
    """

    joint: I64
    place: Array
    turn: Array
    axis: Array
    anchor: Array
    mass: Array
    center: Array
    soles: Array
    radius: Array
    weight: Array

    @classmethod
    def of(cls, model: mujoco.MjModel, handles: RobotHandles) -> "Legs":
        """Return the legs of a robot in a compiled model.

        Raises:
            InputError: a foot is no part of one body, or a body of a leg has several joints or one
                without a servo.
        """
        chains = [_chain(model, handles, soles) for soles in handles.sole_geoms]
        shape = (len(chains), max(map(len, chains)))
        joint, ids = np.full(shape, -2), np.zeros(shape, dtype=np.int64)
        axis, anchor = np.zeros((*shape, 3)), np.zeros((*shape, 3))
        for foot, chain in enumerate(chains):
            ids[foot, : len(chain)] = chain
            for k, body in enumerate(chain):
                joint[foot, k], axis[foot, k], anchor[foot, k] = _hinge(model, handles, body)
        inside = joint > -2
        return cls(
            joint=joint,
            place=model.body_pos[ids],
            turn=quat_to_matrix(model.body_quat[ids]),
            axis=axis,
            anchor=anchor,
            mass=model.body_mass[ids] * inside,
            center=model.body_ipos[ids],
            soles=model.geom_pos[handles.sole_geoms],
            radius=handles.sole_radius_m,
            weight=GRAVITY_M_S2 * model.body_subtreemass[[handles.root_body]],
        )


def _chain(model: mujoco.MjModel, handles: RobotHandles, soles: I64) -> list[int]:
    """Return the bodies of a foot's chain, that of its soles last."""
    bodies = set(model.geom_bodyid[soles].tolist())
    if len(bodies) != 1:
        raise InputError(
            f"a foot of {handles.robot.name} has soles on {len(bodies)} bodies; valid: 1"
        )
    chain = list(bodies)
    while (parent := int(model.body_parentid[chain[0]])) != handles.root_body:
        if parent == 0:
            raise InputError(f"a foot of {handles.robot.name} is on its base; valid: on a leg")
        chain.insert(0, parent)
    return chain


def _hinge(model: mujoco.MjModel, handles: RobotHandles, body: int) -> tuple[int, Array, Array]:
    """Return the index of a body's joint (−1 without one), its axis and anchor."""
    count, first = int(model.body_jntnum[body]), int(model.body_jntadr[body])
    if count == 0:
        return -1, np.zeros(3), np.zeros(3)
    index = np.flatnonzero(handles.joint_dof == model.jnt_dofadr[first])
    if count > 1 or not len(index) or model.jnt_type[first] != mujoco.mjtJoint.mjJNT_HINGE:
        name = model.body(body).name
        raise InputError(f"body {name} of a leg has {count} joints; valid: one hinge with a servo")
    return int(index[0]), model.jnt_axis[first], model.jnt_pos[first]


@kernel()
def foot_motion(legs, foot, joints, speeds, torques, down, point, velocity):
    """Return the share of the robot's weight that a foot carries, judged by the motors' torques.

    Write where its lowest skin is, and with which velocity that point moves, both in the base frame
    as if the base stood still.

    Args:
        legs: the `Legs`.
        foot: index of the foot.
        joints, speeds, torques: (J,) joint positions [rad], velocities [rad/s], torques [Nm].
        down: (3,) direction of gravity in the base frame.
        point, velocity: (3,) outputs [m], [m/s].
    """
    length = legs.joint.shape[1]
    position, rotation = np.zeros(3), np.eye(3)
    axes, anchors, turned = np.zeros((length, 3)), np.zeros((length, 3)), np.zeros((3, 3))
    centers = np.zeros((length, 3))
    step, local = np.zeros(3), np.zeros((3, 3))
    bodies = 0
    for k in range(length):
        index = legs.joint[foot, k]
        if index < -1:
            break
        bodies += 1
        _apply(rotation, legs.place[foot, k], step)
        for i in range(3):
            position[i] += step[i]
        _multiply(rotation, legs.turn[foot, k], turned)
        rotation, turned = turned, rotation
        if index >= 0:
            _apply(rotation, legs.anchor[foot, k], step)
            for i in range(3):
                anchors[k, i] = position[i] + step[i]
            _apply(rotation, legs.axis[foot, k], axes[k])
            _rodrigues(legs.axis[foot, k], joints[index], local)
            _multiply(rotation, local, turned)
            rotation, turned = turned, rotation
            _apply(rotation, legs.anchor[foot, k], step)
            for i in range(3):
                position[i] = anchors[k, i] - step[i]
        _apply(rotation, legs.center[foot, k], step)
        for i in range(3):
            centers[k, i] = position[i] + step[i]
    # The skin under each sphere; the lowest counts, or the mean of those that are as low.
    soles = legs.soles.shape[1]
    depth = np.empty(soles)
    skin = np.empty((soles, 3))
    for s in range(soles):
        _apply(rotation, legs.soles[foot, s], step)
        for i in range(3):
            skin[s, i] = position[i] + step[i] + legs.radius[foot, s] * down[i]
        depth[s] = skin[s, 0] * down[0] + skin[s, 1] * down[1] + skin[s, 2] * down[2]
    lowest, total = depth.max(), 0.0
    point[:] = 0.0
    for s in range(soles):
        share = np.exp((depth[s] - lowest) / SOLE_M)
        total += share
        for i in range(3):
            point[i] += share * skin[s, i]
    for i in range(3):
        point[i] /= total
    # Statics of the leg: torque = −(axis × arm) · force − that of the leg's own weight.
    velocity[:] = 0.0
    normal, right = np.zeros((3, 3)), np.zeros(3)
    row, arm = np.zeros(3), np.zeros(3)
    for k in range(bodies):
        index = legs.joint[foot, k]
        if index < 0:
            continue
        for i in range(3):
            arm[i] = point[i] - anchors[k, i]
        cross(axes[k], arm, row)
        load = torques[index]
        for b in range(k, bodies):
            for i in range(3):
                arm[i] = centers[b, i] - anchors[k, i]
            cross(axes[k], arm, step)
            for i in range(3):
                load += legs.mass[foot, b] * GRAVITY_M_S2 * step[i] * down[i]
        for i in range(3):
            velocity[i] += row[i] * speeds[index]
            right[i] -= row[i] * load
            for j in range(3):
                normal[i, j] += row[i] * row[j]
    for i in range(3):
        normal[i, i] += DAMPING_M2
    # Cramer's rule for the force along gravity.
    cross(normal[1], normal[2], step)
    upward, scale = dot(step, right) * down[0], dot(step, normal[0])
    cross(normal[2], normal[0], step)
    upward += dot(step, right) * down[1]
    cross(normal[0], normal[1], step)
    upward += dot(step, right) * down[2]
    return -upward / scale / legs.weight[0]


SOLE_M = 0.005  # soles this much higher than the lowest one count 1/e as much
DAMPING_M2 = 1e-4  # a straight leg carries weight without any torque


@called()
def _apply(matrix, vector, out):
    for i in range(3):
        out[i] = matrix[i, 0] * vector[0] + matrix[i, 1] * vector[1] + matrix[i, 2] * vector[2]


@called()
def _multiply(a, b, out):
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@called()
def dot(a, b):
    """Return the dot product of two vectors (3,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@called()
def cross(a, b, out):
    """Write the cross product of two vectors (3,)."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@called()
def _rodrigues(axis, angle, out):
    """Write the rotation about a unit axis."""
    sine, cosine = np.sin(angle), np.cos(angle)
    x, y, z = axis[0], axis[1], axis[2]
    rest = 1.0 - cosine
    for i in range(3):
        for j in range(3):
            out[i, j] = axis[i] * axis[j] * rest
        out[i, i] += cosine
    out[0, 1] -= z * sine
    out[1, 0] += z * sine
    out[0, 2] += y * sine
    out[2, 0] -= y * sine
    out[1, 2] -= x * sine
    out[2, 1] += x * sine
