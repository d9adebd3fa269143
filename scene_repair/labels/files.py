"""Read label files beside a scan: vlnpe's format, and that of headset room scans."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ...formats.core.arrays import Array, Mask
from ...formats.core.errors import FileFormatError, brief
from ...formats.core.frames import quat_to_matrix, xyzw_to_wxyz
from ...formats.untrusted.documents import parse_json
from ...formats.untrusted.limits import limits
from ..scan.files import INTERIOR_NAME, LABELS_NAME, MAX_LABELS_BYTES, side_file
from ..scan.soup import MAX_COORDINATE
from .categories import category_of_name

# Half thickness given to flat labels (walls, doors, table tops), in source units.
FLAT = 0.05
# Shorter quaternions define no rotation.
LEAST_QUATERNION = 1e-6


@dataclass(frozen=True)
class LabelBox:
    """A labelled box in source coordinates: centre (3,), axes as rows (3, 3), half sides (3,)."""

    name: str
    category: str
    center: Array
    axes: Array
    half: Array

    def corners(self) -> Array:
        """Return the corners (8, 3)."""
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
        return self.center + (signs * self.half) @ self.axes

    def contains(self, points: Array, margin: float) -> Mask:
        """Return whether points (N, 3) lie in the box grown by `margin`."""
        local = (points - self.center) @ self.axes.T
        return np.all(np.abs(local) <= self.half + margin, axis=1)


def read_labels(source: Path) -> list[LabelBox]:
    """Return the boxes of `<stem>.labels.json` or InteriorGS' `labels.json` beside `source`.

    Raises:
        FileFormatError: of neither format, too large, or a link out of the folder.
    """
    path = source.with_name(LABELS_NAME.format(stem=source.stem))
    text = side_file(path.parent, path.name, MAX_LABELS_BYTES)
    if text is None:
        return read_interior_labels(source.with_name(INTERIOR_NAME))
    try:
        data = parse_json(path, text)
        if isinstance(data, dict):
            if data.get("frame") != "source":
                raise ValueError(f"frame {brief(data.get('frame'))}; valid: 'source'")
            return [_own(entry) for entry in within_limit(path, data["objects"])]
        return [_headset(k, entry) for k, entry in enumerate(within_limit(path, data))]
    # Numbers of hundreds of digits overflow.
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise FileFormatError(
            path,
            f"not a label file ({type(error).__name__}: {brief(str(error))}); valid: an object "
            "with frame 'source' and objects of name, category, lower, upper, or a list of "
            "headset anchors",
        ) from error


def within_limit[T](path: Path, entries: Sequence[T]) -> Sequence[T]:
    """Return the entries; raise FileFormatError if there are more than the limit `labels`."""
    cap = limits().labels
    if len(entries) > cap:
        raise FileFormatError(path, f"has {len(entries):,} labels; valid: up to {cap:,} (labels)")
    return entries


def _own(entry: dict[str, Any]) -> LabelBox:
    lower = np.array(entry["lower"], dtype=np.float64)
    upper = np.array(entry["upper"], dtype=np.float64)
    if lower.shape != (3,) or upper.shape != (3,) or not _bounded(lower, upper):
        raise ValueError(
            f"{brief(entry['name'])}: lower and upper must be three numbers within "
            f"±{MAX_COORDINATE:.0e}"
        )
    return LabelBox(
        str(entry["name"]),
        str(entry["category"]),
        (lower + upper) / 2,
        np.eye(3),
        np.abs(upper - lower) / 2,
    )


def _headset(index: int, entry: dict[str, Any]) -> LabelBox:
    """Return the box of an anchor: a pose, and a rectangle or box in its frame.

    A rectangle lies in the anchor's x-z plane (its "height" runs along z) with the normal along y;
    this was read off room scans, in which walls so end exactly at the floor and ceiling anchors.
    """
    pose = entry["pose"]
    q = pose["orientation"]
    xyzw = np.array([q["x"], q["y"], q["z"], q["w"]], dtype=np.float64)
    length = float(np.linalg.norm(xyzw))
    if not np.isfinite(length) or length < LEAST_QUATERNION:
        raise ValueError(f"{xyzw.tolist()} is not a rotation: its length is {length:g}")
    rotation = quat_to_matrix(xyzw_to_wxyz(xyzw))
    position = np.array([pose["position"][k] for k in "xyz"], dtype=np.float64)
    box, plane = entry.get("box"), entry.get("plane")
    if box:
        corner = np.array([box["offset"][k] for k in "xyz"], dtype=np.float64)
        extent = np.array([box["extent"][k] for k in ("width", "height", "depth")], dtype=float)
    elif plane:
        corner = np.array([plane["offset"]["x"], -FLAT, plane["offset"]["y"]])
        extent = np.array([plane["extent"]["width"], 2 * FLAT, plane["extent"]["height"]])
    else:
        raise ValueError(f"anchor {index} has neither plane nor box")
    if not _bounded(position, corner, extent):
        raise ValueError(f"anchor {index}: its numbers must be within ±{MAX_COORDINATE:.0e}")
    label = str(entry["label"])
    category = category_of_name(label.lower().replace("_", " "))
    return LabelBox(
        f"{label.title().replace('_', '')}_{index}",
        category,
        position + rotation @ (corner + extent / 2),
        rotation.T,
        extent / 2,
    )


def _bounded(*values: Array) -> bool:
    """Return whether all values are finite and plausible for a building."""
    return all(bool((np.abs(v) < MAX_COORDINATE).all()) for v in values)


def read_interior_labels(path: Path) -> list[LabelBox]:
    """Return the boxes of an InteriorGS scene: objects with a label and the 8 corners of a box.

    Layout: the dataset's README and SAGE-3D's public code, which also meets objects without a box.
    A `labels.json` of any other content gives none; damaged corners raise a FileFormatError.
    """
    text = side_file(path.parent, path.name, MAX_LABELS_BYTES)
    if text is None:
        return []
    try:
        data = parse_json(path, text)
    except FileFormatError:
        return []
    if not isinstance(data, list) or not data:
        return []
    if not all(isinstance(e, dict) and "label" in e for e in data):
        return []
    try:
        return [
            _interior(k, entry)
            for k, entry in enumerate(within_limit(path, data))
            if "bounding_box" in entry
        ]
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        raise FileFormatError(
            path, f"not InteriorGS labels ({type(error).__name__}: {brief(str(error))})"
        ) from error


def _interior(index: int, entry: dict[str, Any]) -> LabelBox:
    """Return the upright box around the corners of an object; z is up in InteriorGS."""
    points = np.array([[p["x"], p["y"], p["z"]] for p in entry["bounding_box"]], dtype=np.float64)
    if points.shape != (8, 3) or not _bounded(points):
        raise ValueError(f"object {index} has no box of 8 corners")
    (x, y), (width, depth), degrees = cv2.minAreaRect(points[:, :2].astype(np.float32))
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    low, high = points[:, 2].min(), points[:, 2].max()
    label = str(entry["label"]).lower().replace("_", " ")
    return LabelBox(
        f"{label.title().replace(' ', '')}_{entry.get('ins_id', index)}",
        category_of_name(label) or label,
        np.array([x, y, (low + high) / 2]),
        np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]),
        np.array([width, depth, high - low]) / 2,
    )
