"""URDF of robots, as MuJoCo's own importer reads it."""

import mujoco
import numpy as np
import pytest

from vlnpe.collectors.robots import ROBOTS, get_robot
from vlnpe.rendering.scene.urdf import robot_urdf


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_links_masses_and_joints_are_the_models(name: str) -> None:
    robot = get_robot(name)
    model = robot.build_model(floor=False)
    spec = mujoco.MjSpec.from_string(robot_urdf(robot))
    spec.compiler.fusestatic = False
    spec.compiler.discardvisual = False
    read = spec.compile()
    names = {read.joint(k).name for k in range(read.njnt)}
    assert names == {model.joint(k).name for k in range(1, model.njnt)} >= set(robot.joint_names)
    ours, theirs = mujoco.MjData(model), mujoco.MjData(read)
    rng = np.random.default_rng(0)
    ours.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    for joint in names:
        angle = rng.uniform(-1, 1)
        ours.joint(joint).qpos[:] = theirs.joint(joint).qpos[:] = angle
        limits = model.joint(joint).range, read.joint(joint).range
        np.testing.assert_allclose(*limits, atol=1e-6)
    mujoco.mj_forward(model, ours)
    mujoco.mj_forward(read, theirs)
    bodies = {model.body(k).name for k in range(1, model.nbody)} - {robot.root_body}
    assert bodies <= {read.body(k).name for k in range(read.nbody)}
    for body in bodies:
        shift = model.jnt_pos[model.body(body).jntadr[0]] if model.body(body).jntnum[0] else 0.0
        place = ours.body(body).xpos + ours.body(body).xmat.reshape(3, 3) @ np.broadcast_to(
            shift, 3
        )
        np.testing.assert_allclose(theirs.body(body).xpos, place, atol=1e-6)
        np.testing.assert_allclose(theirs.body(body).xipos, ours.body(body).xipos, atol=1e-6)
        np.testing.assert_allclose(model.body(body).mass, read.body(body).mass, rtol=1e-5)
