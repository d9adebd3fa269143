"""Visual shapes of the Aliengo, without mass or contacts."""

import mujoco

from ..shapes import Color, add_visual

SILVER: Color = (0.62, 0.64, 0.67)
LIGHT: Color = (0.80, 0.81, 0.83)
DARK: Color = (0.09, 0.095, 0.105)
GRAPHITE: Color = (0.20, 0.21, 0.23)
GLASS: Color = (0.02, 0.025, 0.035)
RUBBER: Color = (0.035, 0.035, 0.035)
ACCENT: Color = (0.15, 0.55, 0.85)


def dress_trunk(base: mujoco.MjsBody) -> None:
    """Add a rounded silver hull, dark belly and deck, a head with a glass face and a camera."""
    for y in (-0.062, 0.062):
        add_visual(base, "capsule", (0.05,), SILVER, ends=((-0.25, y, 0.006), (0.25, y, 0.006)))
        # Carrying rails along the deck's edges.
        add_visual(base, "capsule", (0.011,), GRAPHITE, ends=((-0.18, y, 0.06), (0.18, y, 0.06)))
    add_visual(base, "box", (0.25, 0.062, 0.05), SILVER, position=(0.0, 0.0, 0.006))
    add_visual(base, "box", (0.21, 0.045, 0.006), DARK, position=(0.0, 0.0, 0.056))
    add_visual(base, "box", (0.235, 0.075, 0.02), DARK, position=(0.0, 0.0, -0.042))
    for side in (-1.0, 1.0):
        # Dark flank panels with a thin light line.
        add_visual(base, "box", (0.125, 0.004, 0.028), GRAPHITE, position=(0, side * 0.111, 0.0))
        add_visual(base, "box", (0.11, 0.003, 0.003), ACCENT, position=(0, side * 0.1145, 0.012))
    _dress_head(base)
    add_visual(base, "ellipsoid", (0.04, 0.09, 0.05), GRAPHITE, position=(-0.275, 0.0, 0.004))
    add_visual(
        base, "capsule", (0.012,), DARK, ends=((-0.312, -0.035, 0.01), (-0.312, 0.035, 0.01))
    )


def _dress_head(base: mujoco.MjsBody) -> None:
    add_visual(base, "ellipsoid", (0.075, 0.092, 0.058), LIGHT, position=(0.272, 0.0, 0.012))
    add_visual(base, "ellipsoid", (0.045, 0.074, 0.043), GLASS, position=(0.313, 0.0, 0.012))
    for y in (-0.032, 0.032):
        add_visual(base, "cylinder", (0.013,), SILVER, ends=((0.335, y, 0.016), (0.353, y, 0.016)))
        add_visual(base, "cylinder", (0.0095,), GLASS, ends=((0.34, y, 0.016), (0.3545, y, 0.016)))
    add_visual(base, "box", (0.002, 0.012, 0.003), ACCENT, position=(0.358, 0.0, 0.012))
    # The ego camera's housing: its lens is the camera's mount point.
    add_visual(base, "box", (0.025, 0.016, 0.012), GRAPHITE, position=(0.315, 0.0, 0.07))
    add_visual(
        base, "capsule", (0.0135,), GRAPHITE, ends=((0.345, -0.035, 0.088), (0.345, 0.035, 0.088))
    )
    for y in (-0.026, 0.0, 0.026):
        add_visual(base, "cylinder", (0.006,), GLASS, ends=((0.35, y, 0.088), (0.3605, y, 0.088)))


def dress_hip(hip: mujoco.MjsBody, *, front: float, left: float) -> None:
    """Add the abduction motor, along x at the end of the trunk, and the thigh motor across it."""
    add_visual(
        hip, "cylinder", (0.044,), GRAPHITE, ends=((-0.055 * front, 0, 0), (0.035 * front, 0, 0))
    )
    add_visual(hip, "cylinder", (0.036,), DARK, ends=((0.034 * front, 0, 0), (0.042 * front, 0, 0)))
    add_visual(hip, "cylinder", (0.047,), SILVER, ends=((0, 0.018 * left, 0), (0, 0.06 * left, 0)))


def dress_thigh(thigh: mujoco.MjsBody, left: float) -> None:
    """Add a dark tapering thigh under a large disc, the knee motor."""
    add_visual(thigh, "cylinder", (0.05,), DARK, ends=((0, -0.021 * left, 0), (0, 0.03 * left, 0)))
    add_visual(
        thigh, "cylinder", (0.036,), SILVER, ends=((0, 0.03 * left, 0), (0, 0.034 * left, 0))
    )
    add_visual(
        thigh, "box", (0.03, 0.017, 0.075), DARK, position=(-0.004, 0.0, -0.08), euler_deg=(0, 3, 0)
    )
    add_visual(thigh, "capsule", (0.024,), DARK, ends=((-0.004, 0, -0.12), (0.0, 0, -0.235)))
    add_visual(thigh, "box", (0.012, 0.002, 0.05), SILVER, position=(-0.002, 0.0175 * left, -0.1))
    add_visual(thigh, "cylinder", (0.026,), GRAPHITE, ends=((0, -0.023, -0.25), (0, 0.023, -0.25)))


def dress_calf(calf: mujoco.MjsBody) -> None:
    """Add a slim calf with a rubber ball foot."""
    add_visual(calf, "capsule", (0.017,), GRAPHITE, ends=((0.0, 0, -0.005), (0.008, 0, -0.09)))
    add_visual(calf, "capsule", (0.0125,), SILVER, ends=((0.008, 0, -0.085), (0.0, 0, -0.225)))
    add_visual(calf, "capsule", (0.0145,), DARK, ends=((0.002, 0, -0.185), (0.0, 0, -0.24)))
    add_visual(calf, "sphere", (0.0265,), RUBBER, position=(0.0, 0.0, -0.25))
