"""Visual shapes of the G1, without mass or contacts."""

import mujoco

from ..humanoid import SIDES, Bodies
from ..shapes import Color, add_visual

SILVER: Color = (0.66, 0.68, 0.71)
WHITE: Color = (0.82, 0.83, 0.85)
GREY: Color = (0.26, 0.27, 0.29)
DARK: Color = (0.045, 0.047, 0.053)
GLASS: Color = (0.008, 0.009, 0.014)
RUBBER: Color = (0.022, 0.022, 0.024)
LIGHT: Color = (0.25, 0.65, 0.95)


def dress(bodies: Bodies) -> None:
    """Add the visual shapes to all bodies."""
    _dress_pelvis(bodies["pelvis"])
    _dress_waist(bodies)
    _dress_torso(bodies["torso"])
    for side, sign in SIDES:
        _dress_thigh(bodies, side, sign)
        _dress_shank(bodies, side)
        _dress_arm(bodies, side, sign)


def _dress_pelvis(pelvis: mujoco.MjsBody) -> None:
    """Add a dark block between the hip motors with a light plate in front."""
    add_visual(pelvis, "capsule", (0.0565,), DARK, ends=((0, -0.032, -0.065), (0, 0.032, -0.065)))
    add_visual(pelvis, "ellipsoid", (0.03, 0.055, 0.05), SILVER, position=(0.038, 0.0, -0.055))


def _dress_waist(bodies: Bodies) -> None:
    """Add a slim dark column that turns and tilts."""
    add_visual(bodies["waist_yaw"], "cylinder", (0.048,), DARK, ends=((0, 0, -0.03), (0, 0, 0.03)))
    add_visual(bodies["waist_roll"], "sphere", (0.047,), GREY)


def _dress_torso(torso: mujoco.MjsBody) -> None:
    """Add light armour, broad at the shoulders, over an oval dark waist; a pack on the back."""
    add_visual(torso, "cylinder", (0.05,), DARK, ends=((0, 0, 0), (0, 0, 0.06)))
    add_visual(torso, "box", (0.0625, 0.04, 0.09), GREY, position=(0.0, 0.0, 0.13))
    for y in (-0.04, 0.04):
        add_visual(torso, "cylinder", (0.0625,), GREY, ends=((0, y, 0.04), (0, y, 0.22)))
    add_visual(torso, "capsule", (0.067,), SILVER, ends=((0, -0.062, 0.245), (0, 0.062, 0.245)))
    add_visual(torso, "ellipsoid", (0.04, 0.072, 0.078), WHITE, position=(0.048, 0.0, 0.222))
    add_visual(torso, "box", (0.02, 0.062, 0.09), DARK, position=(-0.064, 0.0, 0.18))
    add_visual(torso, "box", (0.002, 0.02, 0.004), GLASS, position=(0.087, 0.0, 0.232))
    _dress_head(torso)


def _dress_head(torso: mujoco.MjsBody) -> None:
    add_visual(torso, "cylinder", (0.042,), DARK, ends=((0.0, 0, 0.29), (0.0, 0, 0.36)))
    add_visual(torso, "ellipsoid", (0.066, 0.066, 0.097), WHITE, position=(0.0, 0.0, 0.4))
    # A tall black visor with a line of light along its edge; the ego camera looks out of it.
    add_visual(torso, "ellipsoid", (0.004, 0.063, 0.091), LIGHT, position=(0.0275, 0.0, 0.4))
    add_visual(torso, "ellipsoid", (0.0495, 0.0605, 0.0885), GLASS, position=(0.024, 0.0, 0.4))


def _dress_thigh(bodies: Bodies, side: str, sign: float) -> None:
    pitch = bodies[f"{side}_hip_pitch"]
    add_visual(pitch, "cylinder", (0.05,), DARK, ends=((0, -0.02 * sign, 0), (0, 0.03 * sign, 0)))
    y, z = 0.052 * sign, -0.0305
    add_visual(pitch, "cylinder", (0.047,), GREY, ends=((-0.05, y, z), (0.052, y, z)))
    roll = bodies[f"{side}_hip_roll"]
    add_visual(roll, "capsule", (0.0475,), SILVER, ends=((0.0, 0, -0.02), (0.025, 0, -0.11)))
    thigh = bodies[f"{side}_hip_yaw"]
    add_visual(thigh, "cylinder", (0.056,), DARK, ends=((-0.008, 0, -0.022), (-0.008, 0, 0.022)))
    add_visual(thigh, "capsule", (0.0505,), SILVER, ends=((-0.025, 0, -0.01), (-0.065, 0, -0.12)))
    x, y, z = -0.0783, 0.0021 * sign, -0.1773
    add_visual(thigh, "cylinder", (0.053,), DARK, ends=((x, y - 0.046, z), (x, y + 0.046, z)))
    add_visual(thigh, "cylinder", (0.036,), SILVER, ends=((x, y - 0.052, z), (x, y + 0.052, z)))


def _dress_shank(bodies: Bodies, side: str) -> None:
    shank = bodies[f"{side}_knee"]
    add_visual(shank, "capsule", (0.0385,), GREY, ends=((0, 0, -0.25), (0, 0, -0.01)))
    add_visual(shank, "ellipsoid", (0.03, 0.038, 0.105), WHITE, position=(0.022, 0, -0.135))
    add_visual(bodies[f"{side}_ankle_pitch"], "sphere", (0.031,), DARK)
    foot = bodies[f"{side}_ankle_roll"]
    for y in (-1, 1):
        ends = ((-0.05, y * 0.025, -0.02), (0.12, y * 0.03, -0.02))
        add_visual(foot, "capsule", (0.015,), RUBBER, ends=ends)
    add_visual(foot, "box", (0.095, 0.027, 0.009), RUBBER, position=(0.035, 0.0, -0.02))
    add_visual(foot, "ellipsoid", (0.075, 0.03, 0.03), GREY, position=(0.025, 0.0, -0.008))


def _dress_arm(bodies: Bodies, side: str, sign: float) -> None:
    pitch = bodies[f"{side}_shoulder_pitch"]
    add_visual(pitch, "cylinder", (0.042,), DARK, ends=((0, -0.03 * sign, 0), (0, 0.03 * sign, 0)))
    roll = bodies[f"{side}_shoulder_roll"]
    add_visual(roll, "cylinder", (0.044,), SILVER, ends=((-0.044, 0, 0), (0.044, 0, 0)))
    arm = bodies[f"{side}_shoulder_yaw"]
    add_visual(arm, "capsule", (0.0365,), SILVER, ends=((0.005, 0, -0.06), (0.005, 0, 0.08)))
    forearm = bodies[f"{side}_elbow"]
    add_visual(forearm, "cylinder", (0.041,), DARK, ends=((0, -0.038, 0), (0, 0.038, 0)))
    add_visual(forearm, "capsule", (0.0325,), WHITE, ends=((0.02, 0, -0.01), (0.1, 0, -0.01)))
    wrist = bodies[f"{side}_wrist_pitch"]
    add_visual(wrist, "capsule", (0.031,), GREY, ends=((-0.005, 0, 0), (0.03, 0, 0)))
    hand = bodies[f"{side}_wrist_yaw"]
    add_visual(hand, "cylinder", (0.033,), DARK, ends=((-0.01, 0, 0), (0.05, 0, 0)))
    add_visual(hand, "ellipsoid", (0.062, 0.036, 0.044), RUBBER, position=(0.074, 0.0, 0.0))
