"""Visibility along a path: rendered ids counted per view and object, as JSON on disk.

The pipeline renders them, the instruction stage reads them.
"""

import contextlib
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..core.atomic import atomic_file
from ..core.errors import FileFormatError

VISIBILITY_VERSION = 2
_PATHS, _END = '"paths":{', "}}"


@dataclass(frozen=True)
class SightCamera:
    """The camera of a visibility record.

    Attributes:
        hfov_deg: horizontal field of view [deg].
        height_m: of the optical centre above the floor [m].
        pitch_down_deg: tilt of the optical axis below the horizon [deg].
        spacing_m: distance between two looks along the path [m].
    """

    robot: str
    width_px: int
    height_px: int
    hfov_deg: float
    height_m: float
    pitch_down_deg: float
    spacing_m: float


@dataclass(frozen=True)
class Glimpse:
    """One object in one image.

    Attributes:
        thing: name of the object in the scene.
        along_m: distance along the path of the look [m].
        pixels: how many pixels show it.
        occluded: fraction of its outline inside the image that something nearer covers, 0 … 1.
        rgb: mean sRGB colour of those pixels, 0 … 255.
    """

    thing: str
    along_m: float
    pixels: int
    occluded: float
    rgb: tuple[int, int, int]


@dataclass(frozen=True)
class PathSight:
    """All objects seen along one path, in order.

    Attributes:
        looks_m: distances along the path at which the camera looked [m].
    """

    looks_m: tuple[float, ...]
    glimpses: tuple[Glimpse, ...]


@dataclass(frozen=True)
class Visibility:
    """Objects seen along the paths of one scene or of several.

    Attributes:
        paths: by trajectory id.
    """

    camera: SightCamera
    paths: Mapping[str, PathSight]


@contextlib.contextmanager
def visibility_writer(
    path: Path, camera: SightCamera
) -> Iterator[Callable[[str, PathSight], None]]:
    """Yield a function that writes one path's sight by its trajectory id; the file is atomic.

    No more than one path is held in memory: the file is one JSON object with a line for each.
    """
    with atomic_file(path) as temporary, temporary.open("w", encoding="utf-8") as out:
        head = _json({"format_version": VISIBILITY_VERSION, "camera": asdict(camera)})
        out.write(head[:-1] + "," + _PATHS)
        between = "\n"

        def write(trajectory_id: str, sight: PathSight) -> None:
            nonlocal between
            glimpses = [
                [g.thing, round(g.along_m, 3), g.pixels, round(g.occluded, 3), list(g.rgb)]
                for g in sight.glimpses
            ]
            distances = [round(along, 3) for along in sight.looks_m]
            record = _json({"looks_m": distances, "glimpses": glimpses})
            out.write(f"{between}{_json(trajectory_id)}:{record}")
            between = ",\n"

        yield write
        out.write(f"\n{_END}\n")


def read_visibility(path: Path, *more: Path) -> Visibility:
    """Read what `visibility_writer` wrote to one file or more, with the camera of the first.

    A path's sight is decoded when it is asked for.
    """
    parts = [_read(file) for file in (path, *more)]
    lines = {name: line for _, named in parts for name, line in named.items()}
    return Visibility(parts[0][0], _Encoded(lines))


def _read(path: Path) -> tuple[SightCamera, dict[str, str]]:
    try:
        first, *lines = path.read_text(encoding="utf-8").splitlines() or [""]
        head: dict[str, Any] = json.loads(first + _END if first.endswith(_PATHS) else first)
        version = head["format_version"]
        if version != VISIBILITY_VERSION:
            raise FileFormatError(path, f"version {version}; this code reads {VISIBILITY_VERSION}")
        camera = SightCamera(**head["camera"])
        if lines[-1] != _END:
            raise FileFormatError(path, "it is cut short")
        # Decoded once here, so that damage is found now; kept as text, which is a tenth.
        return camera, {_decoded(line)[0]: line for line in lines[:-1]}
    except OSError as error:
        raise FileFormatError(path, f"cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        raise FileFormatError(path, f"not a visibility record: {error!r}") from error


class _Encoded(Mapping[str, PathSight]):
    """Sights by trajectory id, as JSON until they are asked for."""

    def __init__(self, lines: Mapping[str, str]):
        self._lines = lines

    def __getitem__(self, key: str) -> PathSight:
        return _decoded(self._lines[key])[1]

    def __iter__(self) -> Iterator[str]:
        return iter(self._lines)

    def __len__(self) -> int:
        return len(self._lines)


def _json(value: object) -> str:
    return json.dumps(value, separators=(",", ":"))


def _decoded(line: str) -> tuple[str, PathSight]:
    ((trajectory_id, record),) = json.loads("{" + line.removesuffix(",") + "}").items()
    glimpses = tuple(
        Glimpse(thing, along, pixels, occluded, (rgb[0], rgb[1], rgb[2]))
        for thing, along, pixels, occluded, rgb in record["glimpses"]
    )
    return trajectory_id, PathSight(tuple(record["looks_m"]), glimpses)
