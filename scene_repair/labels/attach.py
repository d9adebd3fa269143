"""Combine the labels of a scan: its own, a labels file's, and a `.house` file's."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ...formats.core.arrays import Array
from ..orient.bounds import robust_bounds
from ..scan.files import HOUSE_NAME
from ..scan.record import Scan
from .files import LabelBox, read_labels
from .matterport import House, read_house

# Ways in which a z-up building may lie in its file: as it is, or turned y up.
FRAMES = {"z": np.eye(3), "y": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])}
# Bounds of a file and of its labels agree at least this well, as shared over joint volume.
LEAST_AGREEMENT = 0.3
# Boxes of one category that share so much of their joint volume are one thing.
SAME = 0.4


def label_scan(source: Path, scan: Scan) -> tuple[Scan, list[LabelBox]]:
    """Return boxes in the scan's coordinates, and the scan with the up axis its labels imply.

    A labels file goes before names in the scan, and those before a `.house` file: what is there
    twice is taken once.

    Raises:
        FileFormatError: a label file beside the scan is damaged.
    """
    boxes = [replace(box, center=box.center - scan.offset) for box in read_labels(source)]
    path = source.with_name(HOUSE_NAME.format(stem=source.stem))
    house = read_house(path)
    if house is None:
        return scan, boxes
    up, agreement = _frame(house, scan)
    if agreement < LEAST_AGREEMENT:
        line = (
            f"{path.name}: its bounds share {100 * agreement:.0f} % of their volume with the "
            "scan's; its labels are not used"
        )
        return replace(scan, warnings=(*scan.warnings, line)), boxes
    labelled: dict[str, list[Array]] = {}
    for box in boxes:
        labelled.setdefault(box.category, []).append(_bounds(box.corners()))
    for thing, selected in zip(scan.objects, scan.object_faces(), strict=True):
        if len(selected):
            bounds = _bounds(scan.vertices[scan.faces[selected].ravel()])
            labelled.setdefault(thing.category, []).append(bounds)
    bounds_of = {category: np.stack(bounds) for category, bounds in labelled.items()}
    turn = FRAMES[up]
    for box in house.boxes:
        turned = replace(box, center=turn @ box.center - scan.offset, axes=box.axes @ turn.T)
        own = _bounds(turned.corners())
        alike = bounds_of.get(box.category)
        if alike is None or not (_iou(own, alike) > SAME).any():
            boxes.append(turned)
    reason = f"the bounds in {path.name} agree with {up} up ({100 * agreement:.0f} % shared)"
    unit = scan.unit or ("m", f"{path.name} is in metres")
    return replace(scan, up=(up, reason), unit=unit), boxes


def _bounds(points: Array) -> Array:
    return np.stack([points.min(axis=0), points.max(axis=0)])


def _frame(house: House, scan: Scan) -> tuple[str, float]:
    """Return the frame in which the building's bounds fit the scan's best, and how well."""
    bounds_of = np.stack(robust_bounds(scan.vertices, scan.faces)) + scan.offset
    agreement = {
        name: float(_iou(_bounds(np.stack([house.lower, house.upper]) @ turn.T), bounds_of))
        for name, turn in FRAMES.items()
    }
    best = max(agreement, key=lambda name: agreement[name])
    return best, agreement[best]


def _iou(first: Array, second: Array) -> Array:
    """Return the intersection over union (…) of boxes given by their corners (…, 2, 3)."""
    low, high = first[..., 0, :], first[..., 1, :]
    sides = np.minimum(high, second[..., 1, :]) - np.maximum(low, second[..., 0, :])
    both = np.prod(np.maximum(sides, 0.0), axis=-1)
    volumes = np.prod(high - low, axis=-1) + np.prod(second[..., 1, :] - second[..., 0, :], axis=-1)
    joint = volumes - both
    return np.where(joint > 0, both / np.where(joint > 0, joint, 1.0), 0.0)
