"""Visibility along a path: rendered ids counted per moment and object, as JSON on disk.

The pipeline renders them (the renderer lives in `collectors`), the instruction stage reads them.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..core.atomic import write_bytes
from ..core.errors import FileFormatError

VISIBILITY_VERSION = 1


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
    """Objects seen along the paths of one scene.

    Attributes:
        paths: by trajectory id.
        seconds: processor time it took [s], the renderer's start included.
    """

    camera: SightCamera
    paths: Mapping[str, PathSight]
    seconds: float = 0.0


def write_visibility(path: Path, sight: Visibility) -> None:
    """Write `sight` atomically."""
    document = {
        "format_version": VISIBILITY_VERSION,
        "camera": asdict(sight.camera),
        "seconds": round(sight.seconds, 3),
        "paths": {
            name: {
                "looks_m": [round(v, 3) for v in one.looks_m],
                "glimpses": [
                    [g.thing, round(g.along_m, 3), g.pixels, round(g.occluded, 3), list(g.rgb)]
                    for g in one.glimpses
                ],
            }
            for name, one in sight.paths.items()
        },
    }
    write_bytes(path, (json.dumps(document, separators=(",", ":")) + "\n").encode())


def read_visibility(path: Path) -> Visibility:
    """Read the output of `write_visibility`.

    Raises:
        FileFormatError: missing, of another version, or damaged.
    """
    try:
        document: dict[str, Any] = json.loads(path.read_bytes())
        if document["format_version"] != VISIBILITY_VERSION:
            version = document["format_version"]
            raise FileFormatError(path, f"version {version}; this code reads {VISIBILITY_VERSION}")
        paths = {
            name: PathSight(
                tuple(one["looks_m"]),
                tuple(
                    Glimpse(thing, along, pixels, occluded, (rgb[0], rgb[1], rgb[2]))
                    for thing, along, pixels, occluded, rgb in one["glimpses"]
                ),
            )
            for name, one in document["paths"].items()
        }
        return Visibility(SightCamera(**document["camera"]), paths, document["seconds"])
    except OSError as error:
        raise FileFormatError(path, f"cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        raise FileFormatError(path, f"not a visibility record: {error!r}") from error
