"""Motor indices of robots in their maker's SDK, from public sources."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class MotorBus:
    """The motors of one robot as its maker's SDK addresses them.

    Attributes:
        sdk: name of the SDK.
        message: message with the motor commands.
        slots: length of the message's list of motors.
        imu: link that carries the IMU; empty where no source says it.
        index: index in that list of each joint, by the joint's name.
        sources: public files with these facts.
        unconfirmed: what no public source was found to confirm.
    """

    sdk: str
    message: str
    slots: int
    imu: str
    index: Mapping[str, int]
    sources: tuple[str, ...]
    unconfirmed: tuple[str, ...]


def _numbered(names: str, first: int = 0) -> dict[str, int]:
    return {f"{name}_joint": k for k, name in enumerate(names.split(), start=first)}


_QUADRUPED = _numbered(
    " ".join(
        f"{leg}_{part}" for leg in ("FR", "FL", "RR", "RL") for part in ("hip", "thigh", "calf")
    )
)
_ARM = "shoulder_pitch shoulder_roll shoulder_yaw elbow"
_H1 = {
    **_numbered("right_hip_roll right_hip_pitch right_knee left_hip_roll left_hip_pitch left_knee"),
    **_numbered("torso left_hip_yaw right_hip_yaw", 6),  # 9 is not used
    **_numbered("left_ankle right_ankle", 10),
    **_numbered(" ".join(f"right_{part}" for part in _ARM.split()), 12),
    **_numbered(" ".join(f"left_{part}" for part in _ARM.split()), 16),
}
_LEG = "hip_pitch hip_roll hip_yaw knee ankle_pitch ankle_roll"
_G1 = _numbered(
    " ".join(
        [
            *(f"{side}_{part}" for side in ("left", "right") for part in _LEG.split()),
            *("waist_yaw", "waist_roll", "waist_pitch"),
            *(
                f"{side}_{part}"
                for side in ("left", "right")
                for part in (*_ARM.split(), "wrist_roll", "wrist_pitch", "wrist_yaw")
            ),
        ]
    )
)
_SIGNS = (
    "that each motor's zero and direction are those of the joint in Unitree's robot description: "
    "unitree_rl_gym deploys without signs or offsets, and no file says it"
)

MOTORS: dict[str, MotorBus] = {
    "aliengo": MotorBus(
        sdk="unitree_legged_sdk (3.x; the Aliengo is not in unitree_sdk2)",
        message="LowCmd.motorCmd",
        slots=20,
        imu="",
        index=_QUADRUPED,
        sources=("unitreerobotics/unitree_legged_sdk: include/unitree_legged_sdk/quadruped.h",),
        unconfirmed=(
            _SIGNS,
            "where the IMU sits",
            "the number of slots (20, as in later versions)",
        ),
    ),
    "go2": MotorBus(
        sdk="unitree_sdk2",
        message="unitree_go LowCmd.motor_cmd",
        slots=20,
        imu="base",
        index=_QUADRUPED,
        sources=(
            "unitreerobotics/unitree_sdk2_python: example/low_level/unitree_legged_const.py",
            "unitreerobotics/unitree_sdk2: example/go2/go2_stand_example.cpp",
        ),
        unconfirmed=(_SIGNS,),
    ),
    "h1": MotorBus(
        sdk="unitree_sdk2",
        message="unitree_go LowCmd.motor_cmd",
        slots=20,
        imu="torso",
        index=_H1,
        sources=(
            "unitreerobotics/unitree_sdk2: example/h1/low_level/humanoid.hpp",
            "unitreerobotics/unitree_rl_gym: deploy/deploy_real/configs/h1.yaml (legs, IMU)",
        ),
        unconfirmed=(
            _SIGNS,
            "the torso's IMU turns with the torso joint: take its yaw out to get the pelvis",
        ),
    ),
    "g1": MotorBus(
        sdk="unitree_sdk2",
        message="unitree_hg LowCmd.motor_cmd",
        slots=35,
        imu="pelvis",
        index=_G1,
        sources=(
            "unitreerobotics/unitree_sdk2: example/g1/low_level/g1_29dof_example.cpp",
            "unitreerobotics/unitree_rl_gym: deploy/deploy_real/configs/g1.yaml (IMU)",
        ),
        unconfirmed=(
            _SIGNS,
            "ankles are driven in pairs; the SDK's mode_pr = 0 takes pitch and roll, as here",
        ),
    ),
}
