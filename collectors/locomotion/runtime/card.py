"""The JSON card that travels with every policy and says what it was trained on."""

import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from ....formats.core.atomic import write_json
from ....formats.core.errors import FileFormatError, brief
from ....formats.untrusted.documents import read_json_object
from ...robots import RobotSpec
from .footing import POWERS, Footing
from .gait import FACTORS, RATE_HZ, GaitClock
from .observation import layout, past_steps

_ROWS = ("swing_rad", "stance_rad", "forward_rad", "left_rad")
_AIM = ("aim", "aim_limits")
POLICY_FOLDER = Path(__file__).parents[1] / "policies"


class PolicyMismatchError(FileFormatError):
    """A policy was trained on another robot model or another observation layout."""


@dataclass(frozen=True)
class PolicyCard:
    """Facts needed to run a policy, and the record of its training.

    Attributes:
        robot: registry name.
        physics_hash: `RobotSpec.physics_hash()` of the model it was trained on.
        observation: blocks (name, width) in order, as `observation.layout`.
        joints: the joints of action and observation, in order.
        action_scale_rad: joint target = default + gait reference + scale × action.
        action_clip: actions are clipped to ± this.
        default_joint_rad, kp, kd, torque_nm: per joint of the robot.
        speed_rad_s: greatest speed of each motor, None for those without a limit; empty in cards
            written before motors had limits.
        rate_hz: calls per second.
        gait: the gait clock.
        network_sha256: digest of the network's file.
        training: configuration, seed, samples, wall time, versions.
        evaluation: table of `evaluate.py`.
        footing: how the gait follows stairs; None for one that takes the ground as level.
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
    network_sha256: str
    training: dict[str, Any]
    evaluation: dict[str, Any]
    speed_rad_s: tuple[float | None, ...] = ()
    footing: Footing | None = None

    @property
    def past(self) -> int:
        """Number of earlier steps in the observation."""
        return past_steps(self.observation)

    @property
    def sees_ground(self) -> bool:
        """Whether the ground is part of the observation, for a gait with a footing."""
        return any(name == "height_scan_m" for name, _ in self.observation)

    def _layout(self, joints: int) -> list[tuple[str, int]]:
        return layout(joints, self.past, self.footing if self.sees_ground else None)

    def check(self, robot: RobotSpec, path: Path) -> None:
        """Refuse to run on anything but what the policy was trained on.

        Raises:
            PolicyMismatchError: robot, model, default pose, rate or layout differ; says which.
        """
        default_rad = tuple(joint.default_rad for joint in robot.joints)
        pairs = (
            ("robot", self.robot, robot.name),
            ("joints", self.joints, robot.policy_joint_names),
            ("observation layout", self.observation, self._layout(robot.policy_joints)),
            ("action scale", self.action_scale_rad, robot.action_scale_rad),
            ("default pose", self.default_joint_rad, default_rad),
            ("rate", self.rate_hz, RATE_HZ),
            ("model hash", self.physics_hash, robot.physics_hash()),
        )
        for what, trained, given in pairs:
            if trained != given:
                raise PolicyMismatchError(
                    path,
                    f"policy was trained with {what} {trained!r}, this robot has {given!r}; "
                    "train it again (make train-gait)",
                )
        sizes = _gait_sizes(self.gait, len(robot.joints))
        if self.footing:
            sizes += _footing_sizes(self.footing, len(self.gait.foot_offsets), len(robot.joints))
        for name, given, valid in sizes:
            if given not in valid:
                shapes = " or ".join("×".join(map(str, shape)) for shape in valid)
                raise PolicyMismatchError(
                    path, f"{name} is {'×'.join(map(str, given))}; valid: {shapes}"
                )


Shape = tuple[int, ...]


def _gait_sizes(gait: GaitClock, joints: int) -> list[tuple[str, Shape, tuple[Shape, ...]]]:
    """Return the name, shape and valid shapes of a gait's tables.

    Compiled code reads them unchecked.
    """
    feet, none = len(gait.foot_offsets), (0,)
    rows = ((feet, joints),)
    aim = ((3, len(FACTORS)), (3, 2)) if gait.aim else (none, none)
    valid: dict[str, tuple[Shape, ...]] = {
        "stand_rad": ((joints,),),
        **dict.fromkeys(_ROWS, rows),
        "turn_rad": (*rows, none),
        "foot_xy_m": ((feet, 2),),
        "aim": aim[:1],
        "aim_limits": aim[1:],
    }
    return [(f"gait.{name}", _shape(getattr(gait, name)), shapes) for name, shapes in valid.items()]


def _footing_sizes(
    footing: Footing, feet: int, joints: int
) -> list[tuple[str, Shape, tuple[Shape, ...]]]:
    """Return the same of a footing's tables."""
    rows, columns = len(footing.scan_x_m), len(footing.scan_y_m)
    bends = (feet * len(POWERS), joints)
    valid: dict[str, tuple[Shape, ...]] = {
        "scan_x_m": ((max(rows, 3),),),
        "scan_y_m": ((max(columns, 1),),),
        "leg_m": ((3,),),
        "reach_rad": (bends,),
        "bear_rad": ((0,), bends),
    }
    return [(f"footing.{n}", _shape(getattr(footing, n)), shapes) for n, shapes in valid.items()]


def _shape(values: tuple[Any, ...]) -> Shape:
    """Return the shape of a table; a ragged one gets a shape that is never valid."""
    widths = {len(row) if isinstance(row, tuple) else 0 for row in values}
    if len(widths) > 1:
        return (len(values), -1)
    return (len(values), *(width for width in widths if width))


def load_card(path: Path) -> PolicyCard:
    """Read a card.

    Raises:
        FileFormatError: missing or not a card.
    """
    if not path.is_file():
        raise FileFormatError(path, "no policy card here; train one (make train-gait)")
    values = read_json_object(path)
    try:
        values.setdefault("speed_rad_s", ())
        footing = values.setdefault("footing", None)
        values = {f.name: values[f.name] for f in fields(PolicyCard)}
        gait = values["gait"]
        for key in ("foot_offsets", "stand_rad"):
            gait[key] = tuple(gait[key])
        for key in (*_ROWS, "turn_rad", "foot_xy_m", *_AIM):
            gait[key] = tuple(tuple(row) for row in gait.get(key, ()))
        values["gait"] = GaitClock(**gait)
        if footing is not None:
            values["footing"] = Footing.of(footing)
        values["observation"] = [(str(n), int(w)) for n, w in values["observation"]]
        for key in ("joints", "default_joint_rad", "kp", "kd", "torque_nm", "speed_rad_s"):
            values[key] = tuple(values[key])
        card = PolicyCard(**values)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise FileFormatError(path, f"not a policy card: {brief(error)}") from error
    _check_finite(path, {**asdict(card), "training": None, "evaluation": None})
    return card


def _check_finite(path: Path, value: Any, name: str = "") -> None:
    """Check that no number is NaN or infinite, since it would reach the physics."""
    if isinstance(value, float) and not math.isfinite(value):
        raise FileFormatError(path, f"{name} is {value}; valid: finite numbers")
    if isinstance(value, dict):
        for key, inner in value.items():
            _check_finite(path, inner, f"{name}.{key}".lstrip("."))
    elif isinstance(value, list | tuple):
        for inner in value:
            _check_finite(path, inner, name)


def save_card(card: PolicyCard, path: Path) -> None:
    """Write a card, atomically."""
    write_json(path, asdict(card))
