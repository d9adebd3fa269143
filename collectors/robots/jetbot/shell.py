"""Visual shapes of the Jetbot, without mass or contacts.

Positions are those of the toy [m], relative to the middle of its axle; they scale with the robot.
"""

import math
from collections.abc import Callable

import mujoco

from ..shapes import Color, Vector, add_visual

PRINT: Color = (0.83, 0.84, 0.86)
PRINT_SHADE: Color = (0.66, 0.67, 0.70)
YELLOW: Color = (0.86, 0.55, 0.03)
TYRE: Color = (0.025, 0.025, 0.028)
BOARD: Color = (0.02, 0.14, 0.055)
CARRIER: Color = (0.035, 0.20, 0.08)
HEATSINK: Color = (0.10, 0.105, 0.115)
STEEL: Color = (0.60, 0.62, 0.65)
GOLD: Color = (0.75, 0.56, 0.18)
BLACK: Color = (0.02, 0.02, 0.024)
DARK: Color = (0.07, 0.07, 0.08)
GLASS: Color = (0.01, 0.015, 0.03)
BLUE: Color = (0.05, 0.30, 0.75)

Part = Callable[..., None]


def _parts(body: mujoco.MjsBody, scale: float) -> Part:
    """Return `add_visual` for that body, with lengths scaled."""

    def grown(values: Vector) -> list[float]:
        return [scale * v for v in values]

    def part(
        shape: str,
        size: Vector,
        color: Color,
        position: Vector = (0.0, 0.0, 0.0),
        *,
        ends: tuple[Vector, Vector] | None = None,
        euler_deg: Vector | None = None,
    ) -> None:
        scaled = None if ends is None else (grown(ends[0]), grown(ends[1]))
        place = grown(position)
        add_visual(body, shape, grown(size), color, place, ends=scaled, euler_deg=euler_deg)

    return part


def dress_chassis(base: mujoco.MjsBody, scale: float, caster: Vector, ball_m: float) -> None:
    """Add the printed chassis, motors and caster; computer, antennas and camera bracket on top."""
    part = _parts(base, scale)
    # The printed tub: floor, rounded front and rear, side walls with windows, a deck on top.
    part("box", (0.046, 0.036, 0.0015), PRINT, (-0.016, 0.0, -0.0135))
    for y in (-0.0345, 0.0345):
        part("box", (0.046, 0.0015, 0.0145), PRINT, (-0.016, y, 0.0005))
        part("box", (0.016, 0.0018, 0.0065), PRINT_SHADE, (-0.042, y, 0.001))
    for x in (0.0285, -0.0605):
        for y in (-0.0295, 0.0295):
            part("cylinder", (0.0065,), PRINT, ends=((x, y, -0.014), (x, y, 0.015)))
        part("box", (0.0065, 0.0295, 0.0032), PRINT, (x, 0.0, -0.0105))
        part("box", (0.0065, 0.0295, 0.0032), PRINT, (x, 0.0, 0.0118))
    part("box", (0.05, 0.0385, 0.0016), PRINT, (-0.016, 0.0, 0.0165))
    # Power bank between the walls, seen through front and rear.
    part("box", (0.0475, 0.0295, 0.0085), BLACK, (-0.016, 0.0, 0.001))
    part("box", (0.0478, 0.008, 0.0015), STEEL, (-0.016, 0.0, 0.002))
    # Yellow gear motors reach out to the wheels.
    for y in (-1.0, 1.0):
        part("box", (0.012, 0.0045, 0.0095), YELLOW, (-0.004, y * 0.0385, 0.0))
        part("cylinder", (0.009,), YELLOW, ends=((0.0, y * 0.036, 0.0), (0.0, y * 0.0445, 0.0)))
    # Ball caster in its cup.
    x, _, z = caster
    part("cylinder", (1.25 * ball_m,), PRINT_SHADE, ends=((x, 0.0, -0.0135), (x, 0.0, z + 0.002)))
    part("sphere", (ball_m,), STEEL, (x, 0.0, z))
    _dress_computer(part)
    _dress_bracket(part)
    # Two antennas rise from the rear corners and lean outwards.
    for y in (-1.0, 1.0):
        foot, bend, tip = (-0.06, y * 0.033), (-0.064, y * 0.034), (-0.067, y * 0.041)
        part("cylinder", (0.0032,), GOLD, ends=((*foot, 0.0165), (*foot, 0.025)))
        part("capsule", (0.0036,), BLACK, ends=((*foot, 0.024), (*bend, 0.03)))
        part("capsule", (0.0033,), BLACK, ends=((*bend, 0.03), (*tip, 0.083)))


def _dress_computer(part: Part) -> None:
    """Add the Jetson Nano: carrier board on stand-offs, module, heat sink, ports to the rear."""
    for x in (-0.058, 0.026):
        for y in (-0.032, 0.032):
            part("cylinder", (0.0022,), GOLD, ends=((x, y, 0.0165), (x, y, 0.026)))
    part("box", (0.046, 0.037, 0.0009), CARRIER, (-0.016, 0.0, 0.0265))
    part("box", (0.034, 0.0225, 0.0011), BOARD, (-0.004, 0.0, 0.0315))
    part("box", (0.034, 0.0225, 0.0015), BLACK, (-0.004, 0.0, 0.029))
    part("box", (0.0285, 0.0195, 0.0022), HEATSINK, (-0.002, 0.0, 0.0345))
    for k in range(9):
        y = 0.0184 * (k - 4) / 4
        part("box", (0.0285, 0.0008, 0.0065), HEATSINK, (-0.002, y, 0.0425))
    for y, width, height in (
        (-0.026, 0.0068, 0.0062),  # network
        (-0.009, 0.0066, 0.0072),  # two pairs of USB
        (0.0075, 0.0066, 0.0072),
        (0.023, 0.0075, 0.0035),  # HDMI
    ):
        part("box", (0.0085, width, height), STEEL, (-0.0545, y, 0.0275 + height))
        part("box", (0.0012, 0.78 * width, 0.72 * height), DARK, (-0.0625, y, 0.0275 + height))
    # Pin header along one side, a blue USB tongue in each port, a small display on the other.
    part("box", (0.024, 0.0024, 0.0038), BLACK, (-0.006, 0.0325, 0.031))
    for y in (-0.009, 0.0075):
        for z in (0.0315, 0.0385):
            part("box", (0.0016, 0.0042, 0.001), BLUE, (-0.0632, y, z))
    part("box", (0.0175, 0.0052, 0.0012), BLACK, (-0.005, -0.0315, 0.033), euler_deg=(-25, 0, 0))
    part("box", (0.0135, 0.0036, 0.0012), GLASS, (-0.005, -0.0317, 0.0334), euler_deg=(-25, 0, 0))


def _dress_bracket(part: Part) -> None:
    """Add the tilted camera bracket at the front with its small camera board."""
    for y in (-0.014, 0.014):
        part("box", (0.0022, 0.0022, 0.0245), PRINT, (0.0335, y, 0.04), euler_deg=(0, -6, 0))
        part("box", (0.008, 0.0022, 0.0022), PRINT, (0.0285, y, 0.019))
    part("box", (0.0018, 0.0162, 0.0105), PRINT, (0.0325, 0.0, 0.058), euler_deg=(0, 14, 0))


def dress_camera(base: mujoco.MjsBody, scale: float, lens: Vector, pitch_deg: float) -> None:
    """Add a camera board whose lens ends at `lens` (x, y, z) of the toy [m], tilted down."""
    part = _parts(base, scale)
    x, y, z = lens
    tilt = (0.0, pitch_deg, 0.0)
    part("box", (0.0012, 0.0125, 0.012), CARRIER, (x - 0.0125, y, z + 0.001), euler_deg=tilt)
    part("box", (0.003, 0.0048, 0.0048), BLACK, (x - 0.0085, y, z), euler_deg=tilt)
    part("cylinder", (0.0038,), BLACK, ends=((x - 0.0075, y, z), (x - 0.0012, y, z)))
    part("cylinder", (0.0026,), GLASS, ends=((x - 0.002, y, z), (x - 0.0009, y, z)))


def dress_mast(base: mujoco.MjsBody, scale: float, *, foot: Vector, top: Vector) -> None:
    """Add a slim aluminium mast from the deck up to the camera of an enlarged Jetbot."""
    part = _parts(base, scale)
    part("cylinder", (0.0034,), STEEL, ends=(foot, top))
    x, y, z = foot
    part("cylinder", (0.0062,), PRINT, ends=(foot, (x, y, z + 0.012)))
    for share in (0.35, 0.68):
        level = z + share * (top[2] - z)
        part("cylinder", (0.0042,), DARK, ends=((x, y, level - 0.0015), (x, y, level + 0.0015)))
    part("box", (0.005, 0.006, 0.007), PRINT, (top[0] + 0.001, y, top[2] - 0.002))


def dress_wheel(wheel: mujoco.MjsBody, scale: float, *, radius_m: float, side: float) -> None:
    """Add a dark tyre around a yellow hub with spokes, which make its rotation visible."""
    part = _parts(wheel, scale)
    half = 0.0095
    part("cylinder", (radius_m,), TYRE, ends=((0, -0.6 * half, 0), (0, 0.6 * half, 0)))
    part("cylinder", (0.955 * radius_m,), TYRE, ends=((0, -half, 0), (0, half, 0)))
    out = side * half
    part("cylinder", (0.78 * radius_m,), YELLOW, ends=((0, -half - 2e-4, 0), (0, half + 2e-4, 0)))
    part("cylinder", (0.62 * radius_m,), DARK, ends=((0, 0, 0), (0, out + side * 5e-4, 0)))
    face = out + side * 6e-4
    for spoke in range(5):
        turn = 2 * math.pi * spoke / 5
        x, z = 0.33 * radius_m * math.sin(turn), 0.33 * radius_m * math.cos(turn)
        tilt = (0.0, math.degrees(turn), 0.0)
        part("box", (0.0022, 0.0008, 0.33 * radius_m), YELLOW, (x, face, z), euler_deg=tilt)
    # The valve, which shows how far the wheel has turned.
    part(
        "cylinder",
        (0.0028,),
        PRINT,
        ends=((0, out, 0.7 * radius_m), (0, out + side * 9e-4, 0.7 * radius_m)),
    )
    part("cylinder", (0.0062,), YELLOW, ends=((0, 0, 0), (0, out + side * 18e-4, 0)))
    part("cylinder", (0.0022,), STEEL, ends=((0, 0, 0), (0, out + side * 24e-4, 0)))
