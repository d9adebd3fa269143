"""Rigs: cameras at a height above the floor, instead of a robot's own."""

import re
from dataclasses import dataclass

from ...formats.core.errors import InputError, UnknownNameError

LEVEL = "level"
HEIGHT_CM, PITCH_DEG = (5, 300), (-90, 90)
# The settings of InternVLA-N1; and heights h [m] of NavDP's generator with the pitch that it gives
# them: 180 h − 120 degrees, at least 0 and at most 30.
RIG_PRESETS = {
    "rig:n1": ("125cm_0deg", "125cm_30deg", "125cm_45deg", "60cm_15deg", "60cm_30deg"),
    "rig:navdp": ("25cm_0deg", "50cm_0deg", "75cm_15deg", "100cm_30deg", "125cm_30deg"),
}
RIG_NAMES = (*RIG_PRESETS, "rig:125cm_30deg")
_SETTING = re.compile(r"(?P<height>\d+(?:\.\d+)?)cm_(?P<pitch>-?\d+(?:\.\d+)?)deg")
_IN_FOLDER = re.compile(r"rig-[\d.]+cm_-?[\d.]+deg")


@dataclass(frozen=True)
class Rig:
    """A mount above or below a robot's own camera, looking straight ahead.

    Attributes:
        height_m: Height of the optical centre above the floor on which the robot stands.
        pitch_down_deg: Downward tilt while it stands.
        level: Whether the camera keeps that tilt; else it sways with the body.
    """

    height_m: float
    pitch_down_deg: float
    level: bool = False

    def __post_init__(self) -> None:
        """Raise InputError if no camera can be mounted so.

        Values are rounded, so that equal names are equal rigs.
        """
        object.__setattr__(self, "height_m", round(self.height_m, 5))
        object.__setattr__(self, "pitch_down_deg", round(self.pitch_down_deg, 3) + 0.0)
        for what, value, (low, high), unit in (
            ("height", 100 * self.height_m, HEIGHT_CM, " cm"),
            ("pitch", self.pitch_down_deg, PITCH_DEG, "° down"),
        ):
            if not low <= round(value, 3) <= high:
                raise InputError(f"camera {what} {value:g}{unit}; valid: {low} to {high}{unit}")

    @property
    def setting(self) -> str:
        """Return height and pitch, for example `125cm_30deg`."""
        return f"{100 * self.height_m:g}cm_{self.pitch_down_deg:g}deg"

    @property
    def name(self) -> str:
        """Return what `parse_rigs` reads."""
        return f"rig:{self.setting}{f':{LEVEL}' if self.level else ''}"


def is_rig(camera: str) -> bool:
    """Return whether a camera's name is a rig's."""
    return camera.partition(":")[0] == "rig"


def parse_rigs(text: str) -> list[Rig]:
    """Parse `rig:125cm_30deg`, or a preset, each with or without `:level`.

    Raises:
        InputError: If there is no such preset, or height or pitch is not valid.
    """
    name = text.removesuffix(f":{LEVEL}")
    settings = RIG_PRESETS.get(name, (name.removeprefix("rig:"),))
    rigs = [
        Rig(float(match["height"]) / 100, float(match["pitch"]), name != text)
        for match in map(_SETTING.fullmatch, settings)
        if match
    ]
    if not rigs:
        raise UnknownNameError("camera", text, RIG_NAMES)
    return rigs


def without_rig(folder: str) -> str:
    """Return the name that folders of views share which differ in height and pitch alone."""
    return _IN_FOLDER.sub("rigs", folder)
