"""A gait's card for deployment: all that a program needs to run the gait on a robot."""

import math
import shutil
from dataclasses import asdict
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ....formats.core.atomic import atomic_file, write_json
from ...robots import TIMESTEP_S, RobotSpec
from ..runtime.policy import GaitPolicy, policy_files
from .motors import MOTORS
from .recording import recorded_walk

_BLOCKS = {
    "linear_velocity_base_m_s": ("m/s", "velocity of the base in its own frame"),
    "angular_velocity_base_rad_s": ("rad/s", "gyroscope, base frame"),
    "gravity_base": ("1", "unit vector downwards in the base frame, (0, 0, -1) when level"),
    "command_vx_vy_yaw": ("m/s, rad/s", "command after limits, brake and calibration"),
    "gait_phase_sin_cos": ("1", "sine and cosine of 2 pi times the phase; zeros while standing"),
    "joint_minus_default_rad": ("rad", "encoders minus default_joint_rad"),
    "joint_velocity_rad_s": ("rad/s", "encoders"),
    "previous_action": ("1", "the network's last output, clipped"),
    "slope": ("1", "rise over run of the ground, forward; gravity and joints are as if it were 0"),
    "height_scan_m": ("m", "ground at the points of `footing` over the line through them"),
}


def deployment(robot: RobotSpec, policy: GaitPolicy) -> dict[str, Any]:
    """Return what a robot's policy card lacks for running the gait outside of vlnpe.

    All values are JSON values; lengths are in metres, angles in radians unless the key says so.
    """
    card, bus = policy.card, MOTORS.get(robot.name)
    late_substeps = card.training.get("anticipation", {}).get("late_substeps", 0)
    limits = robot.command_limits
    return {
        "frames": "x forward, y left, z up; quaternions w, x, y, z; joint angles as in the MJCF",
        "rates_hz": {"policy": card.rate_hz, "servo": 1.0 / TIMESTEP_S},
        "sdk": None if bus is None else {k: v for k, v in asdict(bus).items() if k != "index"},
        "joints": [
            {
                "name": joint.name,
                "motor": None if bus is None else bus.index.get(joint.name),
                "moved_by": "policy" if k < robot.policy_joints else "gait reference",
                "default_rad": joint.default_rad,
                "range_rad": joint.range_rad,
                "kp_nm_rad": joint.kp,
                "kd_nm_s_rad": joint.kd,
                "torque_nm": joint.torque_nm,
                "speed_rad_s": joint.speed_rad_s if math.isfinite(joint.speed_rad_s) else None,
                "full_torque_up_to_share_of_speed": joint.full_torque_speed,
            }
            for k, joint in enumerate(robot.joints)
        ],
        "observation": [
            {"name": name, "width": width, "scale": 1.0, "unit": unit, "meaning": meaning}
            for name, width in card.observation
            for unit, meaning in [_block(name)]
        ],
        "target": "default_joint_rad + gait reference + action_scale_rad * clip(action); "
        "torque = kp * (target - position) - kd * velocity, clipped to torque_nm",
        "safety": {
            "command": {
                "vx_m_s": limits.vx_m_s,
                "vy_m_s": limits.vy_m_s,
                "yaw_rad_s": limits.yaw_rad_s,
            },
            "roll_rad": robot.fall.roll_rad,
            "pitch_rad": robot.fall.pitch_rad,
            "center_of_mass_above_foot_m": robot.fall.com_to_foot_m,
        },
        "delay_ms": {
            "action_anticipated": 1000.0 * TIMESTEP_S * late_substeps,
            "camera": None,  # not modelled: frames show the instant of their time stamp
        },
        "camera": _camera(robot),
    }


def _camera(robot: RobotSpec) -> dict[str, Any]:
    """Return the camera's mount on the moving link that carries it, through all fixed ones."""
    model, image = robot.build_model(), robot.camera.model
    data, camera = mujoco.MjData(model), model.camera(robot.camera.name).id
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    link = model.body_weldid[model.cam_bodyid[camera]]
    to_link = data.xmat[link].reshape(3, 3).T
    ahead = to_link @ -data.cam_xmat[camera].reshape(3, 3)[:, 2]
    return {
        "link": model.body(link).name,
        "position_m": (to_link @ (data.cam_xpos[camera] - data.xpos[link])).round(6).tolist(),
        "pitch_down_deg": round(math.degrees(math.asin(np.clip(-ahead[2], -1.0, 1.0))), 3) + 0.0,
        "size_px": (image.width_px, image.height_px),
        "hfov_deg": image.hfov_deg,
    }


def _block(name: str) -> tuple[str, str]:
    """Return unit and meaning of a block of the observation, of the present or of an older step."""
    if not name.endswith("_ago"):
        return _BLOCKS[name]
    present, steps = name.removesuffix("_ago").rsplit("_", 1)
    unit, meaning = _BLOCKS[present]
    return unit, f"{meaning}, {steps} steps ago"


def write_deployment(robot: RobotSpec, out: Path) -> dict[str, Any]:
    """Write `<robot>.json`, the policy card with its `deployment`, and the network beside it.

    `<robot>-walk.npz` is a recorded walk to check a program with; see `recorded_walk`.

    Returns:
        The card, as written.

    Raises:
        FileFormatError: the robot has no usable policy.
    """
    policy = GaitPolicy.load(robot)
    network, _ = policy_files(robot)
    card = {**asdict(policy.card), "deployment": deployment(robot, policy)}
    walk = recorded_walk(robot, policy)
    out.mkdir(parents=True, exist_ok=True)
    with atomic_file(out / f"{robot.name}{network.suffix}") as temporary:
        shutil.copyfile(network, temporary)
    with atomic_file(out / f"{robot.name}-walk.npz") as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **walk)
    write_json(out / f"{robot.name}.json", card)
    return card
