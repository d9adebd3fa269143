"""Read a LeRobot dataset's meta/info.json, an untrusted file.

Its path templates are filled in by `str.format` and its feature names become file names, by LeRobot
and here; both are checked before anything relies on them.
"""

import math
import re
from pathlib import Path
from string import Formatter
from typing import Any

from ..core.errors import FileFormatError, brief
from ..untrusted.documents import read_json_object
from ..untrusted.files import is_relative, require_inside
from .layout import CODEBASE_VERSION, INFO_PATH

PLACE_FIELDS = ("chunk_index", "file_index")
TEMPLATES = {"data_path": PLACE_FIELDS, "video_path": (*PLACE_FIELDS, "video_key")}
MAX_FPS = 10_000
MAX_VIDEO_S = 1e7
MAX_SIDE = 1 << 16
_FEATURE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.\- ]{0,199}")
_WIDTH = re.compile(r"0?[0-9]?d?")
_CONVERT = (
    "convert a copy of it with LeRobot's own script: python -m "
    "lerobot.scripts.convert_dataset_v21_to_v30 --repo-id=NAME --root=FOLDER --push-to-hub=false"
)


class ForeignDatasetError(FileFormatError):
    """A dataset is sound but not one of vlnpe: another version of LeRobot's, or other columns."""


def read_info(root: Path) -> dict[str, Any]:
    """Read and check meta/info.json.

    Raises:
        ForeignDatasetError: another version of the format, such as v2.1.
        FileFormatError: missing, damaged, or with a template or a name that leads out of `root`.
    """
    path = root / INFO_PATH
    if not path.exists():
        raise FileFormatError(path, "missing; not a LeRobot dataset")
    info = read_json_object(path, root=root)
    version = info.get("codebase_version")
    if version != CODEBASE_VERSION:
        older = isinstance(version, str) and version.startswith(("v1", "v2"))
        advice = f"; {_CONVERT}" if older else ""
        name = version[:40] if isinstance(version, str) else f"version {brief(version)}"
        valid = f"valid: LeRobot {CODEBASE_VERSION}{advice}"
        raise ForeignDatasetError(path, f"LeRobot {name}; {valid}")
    check_features(path, info.get("features"))
    rate = info.get("fps")
    if isinstance(rate, bool) or not isinstance(rate, int | float) or not 0 < rate <= MAX_FPS:
        raise FileFormatError(path, f"fps is {brief(rate)}; valid: above 0, up to {MAX_FPS:,}")
    for key, fields in TEMPLATES.items():
        if info.get(key) is not None:
            check_template(path, key, info[key], fields)
    return info


def check_features(path: Path, features: Any) -> None:
    """Check the features of a dataset or unit: names that are file names, types and shapes."""
    if not isinstance(features, dict):
        raise FileFormatError(path, f"not a LeRobot dataset: features is {brief(features)}")
    for name, feature in features.items():
        if not _FEATURE.fullmatch(name):
            valid = "letters, digits, '_', '-' and '.'"
            raise FileFormatError(path, f"feature {brief(name)}; valid: {valid}")
        shape = feature.get("shape") if isinstance(feature, dict) else None
        if (
            not isinstance(feature, dict)
            or not isinstance(feature.get("dtype"), str)
            or not isinstance(shape, list | tuple)
            or any(type(side) is not int or not 0 <= side <= MAX_SIDE for side in shape)
            or math.prod(shape) > MAX_SIDE**2
        ):
            raise FileFormatError(path, f"feature {name!r} is {brief(feature)}")


def check_template(path: Path, key: str, template: Any, fields: tuple[str, ...]) -> None:
    """Check that a path template is relative and takes whole numbers and names alone."""
    try:
        if not isinstance(template, str):
            raise ValueError("no text")
        for _, name, width, conversion in Formatter().parse(template):
            if name is None:
                continue
            if name not in fields or conversion or not _WIDTH.fullmatch(width or ""):
                raise ValueError(f"field {brief(name)}")
    except ValueError as error:
        valid = "a path with " + ", ".join(f"{{{name}}}" for name in fields)
        reason = f"{key} is {brief(template)} ({error}); valid: {valid}"
        raise FileFormatError(path, reason) from error
    if not is_relative(template):
        reason = f"{key} is {brief(template)}, which leads out of the dataset"
        raise FileFormatError(path, f"{reason}; valid: relative")


def video_start_s(root: Path, value: Any) -> float:
    """Return where an episode's frames begin in their video [s], as meta/episodes states it."""
    if not isinstance(value, int | float) or not 0 <= value <= MAX_VIDEO_S:
        raise FileFormatError(root, f"an episode's video starts at {brief(value)} s")
    return value


def fill_template(root: Path, template: str, **fields: Any) -> Path:
    """Return the file that a checked template names; links must not lead it out of `root`."""
    try:
        relative = template.format(**fields)
    except (ValueError, TypeError, KeyError, IndexError, AttributeError) as error:
        raise FileFormatError(root, f"{brief(template)} of {brief(fields)}: {error}") from error
    if not is_relative(relative):
        raise FileFormatError(root, f"{brief(relative)} leads out of the dataset")
    path = root / relative
    require_inside(path, root)
    return path
