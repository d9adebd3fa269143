"""Visual shapes of the H1, without mass or contacts."""

import mujoco

from ..humanoid import SIDES, Bodies
from ..shapes import Color, add_visual

SHELL: Color = (0.105, 0.108, 0.118)
PLATE: Color = (0.21, 0.215, 0.23)
DARK: Color = (0.035, 0.036, 0.04)
STEEL: Color = (0.50, 0.52, 0.55)
GLASS: Color = (0.008, 0.009, 0.013)
RUBBER: Color = (0.02, 0.02, 0.022)
RING: Color = (0.34, 0.35, 0.37)
LIGHT: Color = (0.75, 0.85, 0.95)


def dress(bodies: Bodies) -> None:
    """Add the visual shapes to all bodies."""
    _dress_pelvis(bodies["pelvis"])
    _dress_torso(bodies["torso"])
    for side, sign in SIDES:
        _dress_hip(bodies, side, sign)
        _dress_leg(bodies, side)
        _dress_arm(bodies, side, sign)


def _dress_pelvis(pelvis: mujoco.MjsBody) -> None:
    """Add a bridge between the two upright motors that turn the legs, under the waist's motor."""
    add_visual(pelvis, "capsule", (0.071,), SHELL, ends=((0, -0.06, -0.05), (0, 0.06, -0.05)))
    add_visual(pelvis, "cylinder", (0.066,), DARK, ends=((0, 0, -0.02), (0, 0, 0.09)))
    for y in (-0.0875, 0.0875):
        add_visual(pelvis, "cylinder", (0.064,), DARK, ends=((0, y, -0.135), (0, y, -0.04)))


def _dress_torso(torso: mujoco.MjsBody) -> None:
    """Add a flat trunk, rounded in front, with a lighter chest plate and a battery on the back."""
    add_visual(torso, "box", (0.0685, 0.1205, 0.2005), SHELL, position=(-0.017, 0.0, 0.28))
    add_visual(torso, "box", (0.02, 0.086, 0.2005), SHELL, position=(0.0655, 0.0, 0.28))
    for y in (-0.0865, 0.0865):
        ends = ((0.0515, y, 0.0795), (0.0515, y, 0.4805))
        add_visual(torso, "cylinder", (0.034,), SHELL, ends=ends)
    add_visual(torso, "ellipsoid", (0.08, 0.115, 0.04), SHELL, position=(0.0, 0.0, 0.475))
    add_visual(torso, "box", (0.005, 0.078, 0.14), PLATE, position=(0.085, 0.0, 0.315))
    add_visual(torso, "box", (0.02, 0.08, 0.15), DARK, position=(-0.09, 0.0, 0.27))
    add_visual(torso, "box", (0.002, 0.036, 0.005), LIGHT, position=(0.089, 0.0, 0.415))
    _dress_head(torso)


def _dress_head(torso: mujoco.MjsBody) -> None:
    add_visual(torso, "cylinder", (0.048,), DARK, ends=((0.012, 0, 0.46), (0.012, 0, 0.56)))
    add_visual(torso, "ellipsoid", (0.08, 0.08, 0.128), SHELL, position=(0.02, 0.0, 0.648))
    # The face is an upright oval ring around dark glass.
    add_visual(torso, "ellipsoid", (0.024, 0.083, 0.123), RING, position=(0.07, 0.0, 0.655))
    add_visual(torso, "ellipsoid", (0.035, 0.0665, 0.102), GLASS, position=(0.0755, 0.0, 0.655))
    # The ego camera's housing: its lens is the camera's mount point.
    add_visual(torso, "capsule", (0.011,), SHELL, ends=((0.106, -0.03, 0.68), (0.106, 0.03, 0.68)))


def _dress_hip(bodies: Bodies, side: str, sign: float) -> None:
    """Add a motor along the robot below the upright one, then the large one across it."""
    yaw = bodies[f"{side}_hip_yaw"]
    add_visual(yaw, "cylinder", (0.06,), DARK, ends=((-0.1, 0, 0), (0.09, 0, 0)))
    add_visual(yaw, "cylinder", (0.042,), STEEL, ends=((-0.104, 0, 0), (0.094, 0, 0)))
    pitch = bodies[f"{side}_hip_pitch"]
    add_visual(pitch, "cylinder", (0.078,), DARK, ends=((0, -0.06 * sign, 0), (0, 0.06 * sign, 0)))
    cap = ((0, 0.06 * sign, 0), (0, 0.066 * sign, 0))
    add_visual(pitch, "cylinder", (0.052,), STEEL, ends=cap)


def _dress_leg(bodies: Bodies, side: str) -> None:
    thigh = bodies[f"{side}_hip_pitch"]
    add_visual(thigh, "capsule", (0.0625,), SHELL, ends=((0, 0, -0.33), (0, 0, -0.07)))
    add_visual(thigh, "cylinder", (0.064,), DARK, ends=((0, -0.056, -0.4), (0, 0.056, -0.4)))
    add_visual(thigh, "cylinder", (0.04,), STEEL, ends=((0, -0.062, -0.4), (0, 0.062, -0.4)))
    shank = bodies[f"{side}_knee"]
    add_visual(shank, "capsule", (0.0465,), SHELL, ends=((0, 0, -0.375), (0, 0, -0.01)))
    foot = bodies[f"{side}_ankle"]
    for y in (-0.035, 0.035):
        add_visual(foot, "capsule", (0.02,), RUBBER, ends=((-0.05, y, -0.05), (0.17, y, -0.05)))
    add_visual(foot, "box", (0.118, 0.036, 0.0175), RUBBER, position=(0.06, 0.0, -0.05))
    add_visual(foot, "ellipsoid", (0.105, 0.042, 0.04), SHELL, position=(0.045, 0.0, -0.035))


def _dress_arm(bodies: Bodies, side: str, sign: float) -> None:
    pitch = bodies[f"{side}_shoulder_pitch"]
    add_visual(pitch, "cylinder", (0.053,), DARK, ends=((0, -0.04 * sign, 0), (0, 0.03 * sign, 0)))
    roll = bodies[f"{side}_shoulder_roll"]
    add_visual(roll, "cylinder", (0.056,), SHELL, ends=((-0.056, 0, 0), (0.056, 0, 0)))
    add_visual(roll, "cylinder", (0.037,), STEEL, ends=((-0.06, 0, 0), (0.06, 0, 0)))
    arm = bodies[f"{side}_shoulder_yaw"]
    add_visual(arm, "capsule", (0.042,), SHELL, ends=((0, 0, -0.17), (0, 0, 0.1)))
    forearm = bodies[f"{side}_elbow"]
    add_visual(forearm, "cylinder", (0.045,), DARK, ends=((0, -0.045, 0), (0, 0.045, 0)))
    add_visual(forearm, "capsule", (0.0365,), SHELL, ends=((0.02, 0, -0.01), (0.24, 0, -0.01)))
    add_visual(forearm, "sphere", (0.044,), RUBBER, position=(0.265, 0.0, -0.01))
