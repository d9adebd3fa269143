"""The robot in MCAP files stands where the renderer draws it."""

import numpy as np
import pytest

from tests.support.walks import glide
from vlnpe.collectors.robots import ROBOTS, get_robot
from vlnpe.formats.core.frames import quat_to_matrix
from vlnpe.rendering.scene.link_shapes import robot_links
from vlnpe.rendering.scene.robot_body import RobotBody

pytestmark = pytest.mark.chain


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_shapes_lie_where_the_renderer_draws_them(name: str) -> None:
    robot = get_robot(name)
    model = robot.build_model(floor=False)
    rollout = glide([[1.0, 1.0], [2.0, 1.5]], name)
    rollout.joint_position_rad[:] += 0.1 * np.arange(len(rollout.joint_names))
    links = robot_links(model, rollout, 20)
    body = RobotBody(model, rollout.joint_names)
    sample = 40
    posed = body.pose(
        rollout.position_world_m[sample],
        rollout.quat_wxyz[sample],
        rollout.joint_position_rad[sample],
    )
    turn, at = quat_to_matrix(rollout.quat_wxyz[sample]), rollout.position_world_m[sample]
    centers = []
    for k, shapes in enumerate(links.shapes):
        link = quat_to_matrix(links.quat_wxyz[2, k])
        for shape in shapes:
            corners = shape.size_m if shape.corners_m is None else np.ptp(shape.corners_m, (0, 1))
            assert (corners > 0).all()
            center = links.position_base_m[2, k] + link @ shape.position_link_m
            centers.append(turn @ center + at)
    centers = np.array(centers).reshape(-1, 3)
    # A capsule is three shapes; each geom's own centre is one of the shapes'.
    for center in posed.position_world_m:
        assert np.linalg.norm(centers - center, axis=1).min() < 1e-9
    assert len(centers) >= len(posed.position_world_m)
