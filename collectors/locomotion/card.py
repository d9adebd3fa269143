"""The JSON card that travels with every policy and says what it was trained on."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from ...formats.atomic import write_json
from ...formats.errors import FileFormatError
from ..robots import RobotSpec
from .gait import GaitClock
from .observation import layout

_AIM = ("aim", "aim_limits")
POLICY_FOLDER = Path(__file__).parent / "policies"


class PolicyMismatchError(FileFormatError):
    """A policy was trained on another robot model or another observation layout."""


@dataclass(frozen=True)
class PolicyCard:
    """Everything needed to run a policy rightly, and how it came to be.

    Attributes:
        robot: registry name.
        physics_hash: `RobotSpec.physics_hash()` of the model it was trained on.
        observation: blocks (name, width) in order, as `observation.layout`.
        joints: the joints of action and observation, in order.
        action_scale_rad: joint target = default + gait reference + scale × action.
        action_clip: actions are clipped to ± this.
        default_joint_rad, kp, kd, torque_nm: per joint of the robot.
        rate_hz: calls per second.
        gait: the gait clock.
        onnx_sha256: digest of the ONNX file.
        training: configuration, seed, samples, wall time, versions.
        evaluation: table of `evaluate.py`.
    """

    robot: str
    physics_hash: str
    observation: list[tuple[str, int]]
    joints: tuple[str, ...]
    action_scale_rad: float
    action_clip: float
    default_joint_rad: tuple[float, ...]
    kp: tuple[float, ...]
    kd: tuple[float, ...]
    torque_nm: tuple[float, ...]
    rate_hz: float
    gait: GaitClock
    onnx_sha256: str
    training: dict[str, Any]
    evaluation: dict[str, Any]

    def check(self, robot: RobotSpec, path: Path) -> None:
        """Refuse to run on anything but what the policy was trained on.

        Raises:
            PolicyMismatchError: robot, model or layout differ; says which.
        """
        pairs = (
            ("robot", self.robot, robot.name),
            ("joints", self.joints, robot.policy_joint_names),
            ("observation layout", self.observation, layout(robot.policy_joints)),
            ("action scale", self.action_scale_rad, robot.action_scale_rad),
            ("model hash", self.physics_hash, robot.physics_hash()),
        )
        for what, trained, given in pairs:
            if trained != given:
                raise PolicyMismatchError(
                    path,
                    f"policy was trained with {what} {trained!r}, this robot has {given!r}; "
                    "train it again (make train-gait)",
                )


def load_card(path: Path) -> PolicyCard:
    """Read a card.

    Raises:
        FileFormatError: missing or not a card.
    """
    if not path.is_file():
        raise FileFormatError(path, "no policy card here; train one (make train-gait)")
    try:
        values = json.loads(path.read_text())
        values = {f.name: values[f.name] for f in fields(PolicyCard)}
        gait = values["gait"]
        for key in ("foot_offsets", "stand_rad"):
            gait[key] = tuple(gait[key])
        for key in (
            "swing_rad",
            "stance_rad",
            "forward_rad",
            "left_rad",
            "turn_rad",
            "foot_xy_m",
            *_AIM,
        ):
            gait[key] = tuple(tuple(row) for row in gait.get(key, ()))
        values["gait"] = GaitClock(**gait)
        values["observation"] = [(str(n), int(w)) for n, w in values["observation"]]
        for key in ("joints", "default_joint_rad", "kp", "kd", "torque_nm"):
            values[key] = tuple(values[key])
        return PolicyCard(**values)
    except (KeyError, TypeError, ValueError) as error:
        raise FileFormatError(path, f"not a policy card: {error!r}") from error


def save_card(card: PolicyCard, path: Path) -> None:
    """Write a card, atomically."""
    write_json(path, asdict(card))
