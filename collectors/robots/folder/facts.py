"""Strict reader of robot.toml, the facts of a user's own robot that are not in its model."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ....formats.core.camera import CameraModel
from ....formats.core.errors import FileFormatError, brief, did_you_mean
from ....formats.untrusted.documents import read_toml
from ..parts import CommandLimits, FallThresholds, Foot, StepRhythm, WheelDrive

FACTS_NAME = "robot.toml"
MAX_FIELD = 120  # characters of a field's name in an error message
NAME_PATTERN = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")


@dataclass(frozen=True)
class FolderFacts:
    """The content of a robot.toml; see docs/reference/robots.md for what each field means.

    Fields that are None are derived from the model: the heights from its default pose, the number
    of policy joints from the number of joints.
    """

    name: str
    title: str
    sources: tuple[str, ...]
    footprint_radius_m: float
    base_height_m: float | None
    spawn_height_m: float | None
    joints: tuple[tuple[str, float], ...]
    policy_joints: int | None
    action_scale_rad: float | None
    feet: tuple[Foot, ...]
    camera_name: str
    camera: CameraModel
    fall: FallThresholds
    command_limits: CommandLimits
    drive: WheelDrive | None
    rhythm: StepRhythm | None


def read_facts(path: Path) -> FolderFacts:
    """Read a robot.toml.

    Raises:
        FileFormatError: the file is missing or no TOML, or a field is missing, unknown or of the
            wrong type; the message names the field and what is valid.
    """
    if not path.exists():
        raise FileFormatError(path, "missing; every robot folder must have one")
    return _Table(path, "", read_toml(path)).facts()


class _Table:
    """One table of the file; keys that have not been read by the end are unknown."""

    def __init__(self, path: Path, name: str, raw: dict[str, Any]):
        self.path, self.name, self.raw = path, name, raw
        self.read_keys: list[str] = []

    def facts(self) -> FolderFacts:
        name = self.text("name")
        if not NAME_PATTERN.fullmatch(name):
            raise self.error("name", f"is {brief(name)}; valid: letters, digits, - and _")
        camera = self.table("camera")
        result = FolderFacts(
            name=name,
            title=self.text("title", name),
            sources=tuple(self.texts("sources", ())),
            footprint_radius_m=self.positive("footprint_radius_m"),
            base_height_m=self.optional_positive("base_height_m"),
            spawn_height_m=self.optional_positive("spawn_height_m"),
            joints=tuple(_joint(table) for table in self.tables("joints")),
            policy_joints=self.count("policy_joints"),
            action_scale_rad=self.optional_positive("action_scale_rad"),
            feet=tuple(_foot(table) for table in self.tables("feet")),
            camera_name=camera.text("name"),
            camera=_camera(camera),
            fall=_fall(self.table("fall")),
            command_limits=_limits(self.table("command_limits")),
            drive=_drive(self.table("drive")) if self.get("drive") is not None else None,
            rhythm=_rhythm(self.table("gait")) if self.get("gait") is not None else None,
        )
        self.refuse_unknown()
        return result

    def error(self, key: str, reason: str) -> FileFormatError:
        """Return the error for the field `key`; `reason` says what is wrong and what is valid."""
        field = f"{self.name}.{key}" if self.name else key
        field = field if len(field) <= MAX_FIELD else f"{field[:MAX_FIELD]}…"
        return FileFormatError(self.path, f"{field} {reason}")

    def get(self, key: str, default: Any = None) -> Any:
        self.read_keys.append(key)
        return self.raw.get(key, default)

    def refuse_unknown(self) -> None:
        for key in self.raw:
            if key not in self.read_keys:
                hint = did_you_mean(key, self.read_keys)
                valid = ", ".join(dict.fromkeys(self.read_keys))
                raise self.error(key, f"is unknown{hint}; valid: {valid}")

    def text(self, key: str, default: str | None = None) -> str:
        value = self.get(key, default)
        if not isinstance(value, str) or not value:
            raise self.error(key, _complaint(value, "a string in quotes"))
        return value

    def texts(self, key: str, default: Sequence[str] | None = None) -> Sequence[str]:
        value = self.get(key, default)
        good = isinstance(value, list | tuple) and all(isinstance(v, str) and v for v in value)
        if not good or (default is None and not value):
            raise self.error(key, _complaint(value, 'a list of strings, e.g. ["a", "b"]'))
        return value

    def number(
        self,
        key: str,
        default: float | None = None,
        least: float = -math.inf,
        valid: str = "a number",
    ) -> float:
        value = self.get(key, default)
        if not _is_number(value) or value < least:
            raise self.error(key, _complaint(value, valid))
        return float(value)

    def positive(self, key: str, default: float | None = None) -> float:
        return self.number(key, default, math.ulp(0.0), "a number above 0")

    def optional_positive(self, key: str) -> float | None:
        return self.positive(key) if self.get(key) is not None else None

    def count(self, key: str) -> int | None:
        value = self.get(key)
        if value is not None and (type(value) is not int or value < 1):
            raise self.error(key, _complaint(value, "a whole number above 0"))
        return value

    def pair(self, key: str) -> tuple[float, float]:
        value = self.get(key)
        good = isinstance(value, list) and len(value) == 2 and all(map(_is_number, value))
        if not good or not value[0] <= 0 <= value[1]:
            raise self.error(key, _complaint(value, "[low, high] with low ≤ 0 ≤ high"))
        return float(value[0]), float(value[1])

    def table(self, key: str) -> "_Table":
        value = self.get(key)
        if not isinstance(value, dict):
            raise self.error(key, _complaint(value, f"a table: [{key}]"))
        return _Table(self.path, key, value)

    def tables(self, key: str) -> "list[_Table]":
        value = self.get(key)
        if not isinstance(value, list) or not all(isinstance(v, dict) for v in value):
            raise self.error(key, _complaint(value, f"a list of tables: [[{key}]]"))
        names = [v.get("name") for v in value]
        twice = next((n for n in names if n is not None and names.count(n) > 1), None)
        if twice is not None:
            raise self.error(key, f"contains the name {brief(twice)} twice; valid: unique names")
        return [
            _Table(self.path, f"{key}.{n}" if isinstance(n, str) else f"{key}[{k}]", v)
            for k, (n, v) in enumerate(zip(names, value, strict=True))
        ]


def _is_number(value: Any) -> bool:
    """Return whether it is a number that a float can hold, which not every integer is."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def _complaint(value: Any, valid: str) -> str:
    return f"{'is missing' if value is None else f'is {brief(value)}'}; valid: {valid}"


def _joint(table: _Table) -> tuple[str, float]:
    joint = table.text("name"), table.number("default_rad", 0.0)
    table.refuse_unknown()
    return joint


def _foot(table: _Table) -> Foot:
    foot = Foot(table.text("name"), tuple(table.texts("soles")))
    table.refuse_unknown()
    return foot


def _camera(table: _Table) -> CameraModel:
    width, height = table.count("width_px") or 256, table.count("height_px") or 256
    hfov = table.positive("hfov_deg", 90.0)
    if hfov >= 180.0:
        raise table.error("hfov_deg", f"is {hfov:g}; valid: above 0, below 180")
    table.refuse_unknown()
    return CameraModel("ego", width, height, hfov)


def _fall(table: _Table) -> FallThresholds:
    usual = FallThresholds(com_to_foot_m=0.0)
    fall = FallThresholds(
        com_to_foot_m=table.number("com_to_foot_m", None, 0.0, "a number, 0 or above"),
        roll_rad=math.radians(table.positive("roll_deg", math.degrees(usual.roll_rad))),
        pitch_rad=math.radians(table.positive("pitch_deg", math.degrees(usual.pitch_rad))),
    )
    table.refuse_unknown()
    return fall


def _limits(table: _Table) -> CommandLimits:
    limits = CommandLimits(
        vx_m_s=table.pair("vx_m_s"),
        vy_m_s=table.pair("vy_m_s"),
        yaw_rad_s=table.pair("yaw_rad_s"),
    )
    table.refuse_unknown()
    return limits


def _drive(table: _Table) -> WheelDrive:
    drive = WheelDrive(
        left=tuple(table.texts("left")),
        right=tuple(table.texts("right")),
        wheel_radius_m=table.positive("wheel_radius_m"),
        track_m=table.positive("track_m"),
        ramp_m_s2=table.positive("ramp_m_s2", 2.0),
        ramp_rad_s2=table.positive("ramp_rad_s2", 5.0),
    )
    both = sorted(set(drive.left) & set(drive.right))
    if both:
        raise table.error(
            "right", f"contains {brief(both[0])}, which is also in left; valid: each wheel once"
        )
    table.refuse_unknown()
    return drive


def _rhythm(table: _Table) -> StepRhythm:
    offsets = table.get("foot_offsets")
    if not (isinstance(offsets, list) and all(_is_number(v) and 0 <= v < 1 for v in offsets)):
        raise table.error(
            "foot_offsets", _complaint(offsets, "a phase from 0 to below 1 for each foot")
        )
    rhythm = StepRhythm(
        frequency_hz=table.positive("frequency_hz"),
        foot_offsets=tuple(float(value) for value in offsets),
        swing_height_m=table.positive("swing_height_m", 0.06),
    )
    table.refuse_unknown()
    return rhythm
