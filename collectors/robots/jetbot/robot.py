"""NVIDIA Jetbot: a small robot on two wheels and a ball caster, at any scale."""

import math

import mujoco

from ....formats.core.errors import InputError
from ..parts import (
    CameraMount,
    CommandLimits,
    FallThresholds,
    Foot,
    JointFacts,
    WheelDrive,
    ego_camera,
)
from ..shapes import (
    add_camera,
    add_collision,
    add_imu,
    add_touch,
    add_wheel,
    set_inertia,
    start_robot,
)
from ..spec import RobotSpec
from .shell import dress_camera, dress_chassis, dress_mast, dress_wheel

DEFAULT_SCALE = 5.0  # VLN-PE's
# The toy: metres and kilograms, about the middle of the axle.
MASS_KG, WHEEL_KG = 0.56, 0.035
WHEEL_RADIUS_M, TRACK_M = 0.03, 0.1125
WHEEL_HALF_WIDTH_M = 0.0095
BALL_RADIUS_M = 0.01
CASTER_M = (-0.054, 0.0, BALL_RADIUS_M - WHEEL_RADIUS_M)
CENTER_M = (-0.02, 0.0, 0.01)  # of the chassis' mass: behind the axle, so that it brakes safely
MOTOR_NM = 0.08  # stall torque of such a gear motor
ROTOR_KG_M2 = 3.2e-5  # its rotor's inertia, seen through gears of 1:48
SERVO_S = 0.4  # servo gain over torque at the default scale; a higher gain makes wheels hop
SPEED_M_S, BACKWARDS_M_S, YAW_RAD_S = 1.0, 0.3, 1.5  # at the default scale
MAST_X_M = 0.026
# Smaller ones vanish in the floor's roughness, larger ones fit into no building.
LEAST_SCALE, MOST_SCALE = 0.2, 50.0
MAST_CAMERA_M = 0.24  # above the floor: 1.2 m at the default scale
BRACKET_CAMERA_M = (0.046, 0.0, 0.0575)
MAST_PITCH_DEG, BRACKET_PITCH_DEG = 10.0, 14.0
WHEELS = {"left": 1.0, "right": -1.0}


def jetbot(scale: float) -> RobotSpec:
    """Return the Jetbot enlarged `scale` times; 1 is the toy.

    Lengths scale with s, masses with s³, torques with s⁴ (weight times length) and speeds with √s,
    so that all sizes are dynamically similar (Froude's law).

    Raises:
        InputError: the scale is outside its limits.
    """
    if not LEAST_SCALE <= scale <= MOST_SCALE:
        raise InputError(f"jetbot@{scale:g}: valid scales are {LEAST_SCALE:g} to {MOST_SCALE:g}")
    name = "jetbot" if scale == DEFAULT_SCALE else f"jetbot@{scale:g}"
    slower = math.sqrt(scale / DEFAULT_SCALE)
    torque_nm = MOTOR_NM * scale**4
    servo = {"kp": 0.0, "kd": SERVO_S * slower * torque_nm, "torque_nm": torque_nm}
    return RobotSpec(
        name=name,
        title="NVIDIA Jetbot" if scale == 1.0 else f"NVIDIA Jetbot x{scale:g}",
        mass_kg=MASS_KG * scale**3,
        joints=tuple(
            JointFacts(f"{side}_wheel_joint", 0.0, (-math.inf, math.inf), **servo)
            for side in WHEELS
        ),
        root_body="base",
        feet=(*(Foot(f"{side}_wheel", (f"{side}_wheel",)) for side in WHEELS), CASTER),
        base_height_m=WHEEL_RADIUS_M * scale,
        spawn_height_m=1.001 * WHEEL_RADIUS_M * scale,
        footprint_radius_m=0.076 * scale,
        camera=_camera(scale),
        # It stands on its wheels up to 45°, so a slight lean is not a fall.
        fall=FallThresholds(com_to_foot_m=0.022 * scale, roll_rad=math.radians(30.0)),
        command_limits=CommandLimits(
            vx_m_s=(-BACKWARDS_M_S * slower, SPEED_M_S * slower),
            vy_m_s=(0.0, 0.0),
            yaw_rad_s=(-YAW_RAD_S / slower, YAW_RAD_S / slower),
        ),
        drive=WheelDrive(
            left=("left_wheel_joint",),
            right=("right_wheel_joint",),
            wheel_radius_m=WHEEL_RADIUS_M * scale,
            track_m=TRACK_M * scale,
            ramp_m_s2=3.0,
            ramp_rad_s2=5.0 / slower**2,
        ),
        sources=(
            "wheel radius 0.03 m, wheel base 0.1125 m, mass 0.56 kg: NVIDIA's Jetbot, times the "
            "scale (mass: cubed, 70 kg at ×5)",
            "scale 5: VLN-PE",
            "camera: VLN-PE's proxy height of 1.2 m at ×5; a Jetbot ×5 is 0.5 m tall, so the "
            "camera of an enlarged one stands on a mast, 0.24 m times the scale above the floor; "
            "up to the true size it sits in its bracket",
            "shape, mass distribution, motor torque (0.08 Nm, times the scale's fourth power) and "
            "rotor inertia: estimated from pictures and from gear motors of this kind",
        ),
        build=build_jetbot,
    )


CASTER = Foot("caster", ("caster",))


def _camera(scale: float) -> CameraMount:
    x, y, z = (scale * v for v in camera_m(scale))
    pitch = MAST_PITCH_DEG if scale > 1 else BRACKET_PITCH_DEG
    return ego_camera("base", (x, y, z), pitch)


def camera_m(scale: float) -> tuple[float, float, float]:
    """Return the lens position (x, y, z) [m], at the size of the toy, for a robot of that scale."""
    if scale > 1:
        return (MAST_X_M + 0.015, 0.0, MAST_CAMERA_M - WHEEL_RADIUS_M)
    return BRACKET_CAMERA_M


def build_jetbot(robot: RobotSpec) -> mujoco.MjSpec:
    """Return the robot alone: collision and visual shapes, servos, sensors, ego camera."""
    assert robot.drive is not None
    scale = robot.drive.wheel_radius_m / WHEEL_RADIUS_M

    def grown(*values: float) -> tuple[float, ...]:
        return tuple(scale * v for v in values)

    spec, base = start_robot(robot)
    size = grown(0.1, 0.075, 0.06)
    set_inertia(base, (MASS_KG - 2 * WHEEL_KG) * scale**3, center_m=grown(*CENTER_M), box_m=size)
    # Chassis with motors and computer, rounded by capsules where it would catch on corners.
    add_collision(base, "chassis", "box", grown(0.046, 0.0385, 0.0165), grown(-0.016, 0.0, 0.0015))
    add_collision(base, "computer", "box", grown(0.046, 0.037, 0.014), grown(-0.016, 0.0, 0.034))
    for name, x in (("front", 0.029), ("rear", -0.061)):
        ends = (grown(x, -0.029, 0.0), grown(x, 0.029, 0.0))
        add_collision(base, name, "capsule", grown(0.008), ends=ends)
    for name, y in (("bracket", -0.012), ("bracket_right", 0.012)):
        ends = (grown(0.0335, y, 0.03), grown(0.0335, y, 0.06))
        add_collision(base, name, "capsule", grown(0.006), ends=ends)
    add_collision(base, "caster", "sphere", grown(BALL_RADIUS_M), grown(*CASTER_M), foot=True)
    # A ball in its cup rolls in every direction: no friction.
    spec.geom("caster").condim = 1
    add_touch(spec, base, "caster", grown(*CASTER_M), 1.3 * scale * BALL_RADIUS_M)
    dress_chassis(base, scale, CASTER_M, BALL_RADIUS_M)
    lens = camera_m(scale)
    if scale > 1:
        foot, top = (MAST_X_M, 0.0, 0.018), (MAST_X_M, 0.0, lens[2] + 0.003)
        add_collision(base, "mast", "capsule", grown(0.005), ends=(grown(*foot), grown(*top)))
        dress_mast(base, scale, foot=foot, top=top)
        dress_camera(base, scale, lens, MAST_PITCH_DEG)
    dress_camera(base, scale, BRACKET_CAMERA_M, BRACKET_PITCH_DEG)
    add_imu(spec, base)
    add_camera(base, robot.camera)
    for (side, left), facts in zip(WHEELS.items(), robot.joints, strict=True):
        name = f"{side}_wheel"
        wheel = base.add_body(name=name, pos=list(grown(0.0, 0.5 * left * TRACK_M, 0.0)))
        width, across = grown(2 * WHEEL_HALF_WIDTH_M, 2 * WHEEL_RADIUS_M)
        set_inertia(
            wheel,
            WHEEL_KG * scale**3,
            center_m=(0.0, 0.0, 0.0),
            box_m=(across, width, across),
        )
        add_wheel(spec, wheel, facts, ROTOR_KG_M2 * scale**5)
        # A tyre with a round tread: it stands on the middle of its width on any slope.
        tread = grown(WHEEL_RADIUS_M, WHEEL_HALF_WIDTH_M, WHEEL_RADIUS_M)
        add_collision(wheel, name, "ellipsoid", tread, foot=True)
        add_touch(spec, wheel, name, (0.0, 0.0, 0.0), 1.05 * scale * WHEEL_RADIUS_M)
        dress_wheel(wheel, scale, radius_m=WHEEL_RADIUS_M, side=left)
    return spec


JETBOT = jetbot(DEFAULT_SCALE)
