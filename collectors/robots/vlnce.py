"""VLN-CE's bodyless agent: Habitat's upright cylinder with a camera, placed along the path.

It is the reference for the cost of embodiment: it has no joints and cannot fall.
"""

import mujoco

from .parts import CommandLimits, FallThresholds, Foot, ego_camera
from .shapes import (
    Color,
    add_camera,
    add_collision,
    add_imu,
    add_touch,
    add_visual,
    set_inertia,
    start_robot,
)
from .spec import RobotSpec

RADIUS_M, HEIGHT_M, CAMERA_M = 0.1, 1.5, 1.25
BASE_M = 0.5 * HEIGHT_M  # the base frame is at the cylinder's centre
MASS_KG = 1.0  # a placeholder: MuJoCo needs a mass, but no force ever moves the agent

POLE: Color = (0.55, 0.57, 0.60)
DARK: Color = (0.05, 0.055, 0.065)
GLASS: Color = (0.01, 0.015, 0.03)
ACCENT: Color = (0.85, 0.35, 0.05)


def build_vlnce(robot: RobotSpec) -> mujoco.MjSpec:
    """Return the agent alone: a cylinder for collisions, a slim pole with a camera to look at."""
    spec, base = start_robot(robot)
    set_inertia(base, MASS_KG, center_m=(0.0, 0.0, 0.0), box_m=(0.2, 0.2, HEIGHT_M))
    # Rounded below, so that it also stands on uneven floor.
    bottom = (0.0, 0.0, RADIUS_M - BASE_M)
    add_collision(base, "base", "sphere", (RADIUS_M,), position=bottom, foot=True)
    add_collision(base, "cylinder", "cylinder", (RADIUS_M,), ends=(bottom, (0.0, 0.0, BASE_M)))
    add_touch(spec, base, "base", bottom, RADIUS_M + 0.005)
    _dress(base)
    add_imu(spec, base)
    add_camera(base, robot.camera)
    return spec


def _dress(base: mujoco.MjsBody) -> None:
    def at(height_m: float, x_m: float = -0.03) -> tuple[float, float, float]:
        return (x_m, 0.0, height_m - BASE_M)

    add_visual(base, "cylinder", (RADIUS_M,), DARK, ends=(at(0.004, 0.0), at(0.014, 0.0)))
    add_visual(base, "cylinder", (0.026,), ACCENT, ends=(at(0.014), at(0.034)))
    add_visual(base, "cylinder", (0.011,), POLE, ends=(at(0.03), at(CAMERA_M - 0.02)))
    add_visual(base, "box", (0.017, 0.034, 0.022), DARK, at(CAMERA_M, -0.026))
    add_visual(base, "cylinder", (0.017,), POLE, ends=(at(CAMERA_M, -0.010), at(CAMERA_M, -0.005)))
    add_visual(base, "cylinder", (0.013,), GLASS, ends=(at(CAMERA_M, -0.006), at(CAMERA_M, -0.002)))
    add_visual(base, "box", (0.003, 0.024, 0.003), ACCENT, at(CAMERA_M + 0.022, -0.026))


VLNCE = RobotSpec(
    name="vlnce",
    title="VLN-CE agent",
    mass_kg=MASS_KG,
    joints=(),
    root_body="base",
    feet=(Foot("base", ("base",)),),
    base_height_m=BASE_M,
    spawn_height_m=BASE_M + 0.001,
    footprint_radius_m=RADIUS_M,
    camera=ego_camera("base", (0.0, 0.0, CAMERA_M - BASE_M), 0.0),
    fall=FallThresholds(com_to_foot_m=0.0),  # it never falls
    command_limits=CommandLimits(vx_m_s=(0.0, 0.0), vy_m_s=(0.0, 0.0), yaw_rad_s=(0.0, 0.0)),
    sources=(
        "radius 0.1 m, height 1.5 m, camera 1.25 m above the floor and level, HFOV 90°: VLN-CE's "
        "agent in Habitat",
        "mass: a placeholder, no force ever moves the agent",
    ),
    build=build_vlnce,
)
