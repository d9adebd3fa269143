"""Typed access to the image operations used on cell maps."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse

from ...formats.core.arrays import I32, I64, Array, Mask

Window = tuple[slice, slice]
SQUARE = np.ones((3, 3), dtype=bool)


def label(mask: Mask, diagonal: bool = False) -> tuple[I32, int]:
    """Label the connected parts of a mask from 1; 0 = background."""
    structure = ndimage.generate_binary_structure(mask.ndim, mask.ndim if diagonal else 1)
    parts: Any = ndimage.label(mask, structure=structure)
    return parts[0], int(parts[1])


def linked(first: NDArray[Any], second: NDArray[Any], count: int) -> I64:
    """Return the group (count,), from 0, of things that pairs (n,), (n,) of numbers link."""
    links = sparse.coo_matrix((np.ones(len(first), bool), (first, second)), shape=(count, count))
    groups: Any = sparse.csgraph.connected_components(links, directed=False)
    return groups[1].astype(np.int64)


def windows(parts: I32) -> list[Window]:
    """Return the bounding windows of all parts, in order."""
    objects: Any = ndimage.find_objects(parts)
    return objects


def grown_window(window: Window, reach: int, shape: tuple[int, ...]) -> Window:
    """Return the window enlarged by `reach` cells on all sides, clipped to the map."""
    rows, columns = window
    return (
        slice(max(rows.start - reach, 0), min(rows.stop + reach, shape[0])),
        slice(max(columns.start - reach, 0), min(columns.stop + reach, shape[1])),
    )


def distance_to(mask: Mask) -> Array:
    """Return the distance of every cell to the nearest true cell, in cells; inf if none."""
    if not mask.any():
        return np.full(mask.shape, np.inf)
    distance: Any = ndimage.distance_transform_edt(~mask)
    return distance


def nearest_in(mask: Mask) -> tuple[NDArray[np.intp], ...]:
    """Return index arrays of the nearest true cell of every cell; at least one must be true."""
    index: Any = ndimage.distance_transform_edt(~mask, return_distances=False, return_indices=True)
    return tuple(index)


def grow(mask: Mask, cells: int = 1, within: Mask | None = None) -> Mask:
    """Dilate by `cells` steps of a 3 × 3 square, only over `within` if given."""
    if within is None and mask.ndim == 2 and mask.size:
        # All steps at once, at a tenth of the cost.
        square = np.ones((2 * cells + 1, 2 * cells + 1), dtype=np.uint8)
        pixels = np.ascontiguousarray(mask, dtype=bool).view(np.uint8)
        return np.asarray(cv2.dilate(pixels, square)).view(np.bool_)
    return ndimage.binary_dilation(mask, structure=SQUARE, iterations=cells, mask=within)


def grow_box(mask: Mask, cells: int = 1) -> Mask:
    """Dilate by `cells` steps of a square, cube, …, as the mask has dimensions.

    The same as SciPy's, which takes ten times longer.
    """
    for axis in np.repeat(np.arange(mask.ndim), cells):
        before, mask = np.moveaxis(mask, axis, 0), mask.copy()
        after = np.moveaxis(mask, axis, 0)
        after[1:] |= before[:-1]
        after[:-1] |= before[1:]
    return mask


def dilated(mask: Mask, size: tuple[int, int]) -> Mask:
    """Return the dilation by a rectangle of that many (rows, columns).

    The same as SciPy's, which takes a hundred times longer for long rectangles.
    """
    rows, columns = size
    return _filtered(cv2.dilate, mask, size, ((columns - 1) // 2, (rows - 1) // 2))


def eroded(mask: Mask, size: tuple[int, int]) -> Mask:
    """Return the erosion by a rectangle of that many (rows, columns); outside nothing is true."""
    rows, columns = size
    return _filtered(cv2.erode, mask, size, (columns // 2, rows // 2))


def closing(mask: Mask, size: tuple[int, int]) -> Mask:
    """Return the closing by a rectangle of that many (rows, columns); outside nothing is true."""
    return eroded(dilated(mask, size), size)


def opening(mask: Mask, size: tuple[int, int]) -> Mask:
    """Return the opening by a rectangle of that many (rows, columns); outside nothing is true."""
    return dilated(eroded(mask, size), size)


def _filtered(filter_: Any, mask: Mask, size: tuple[int, int], anchor: tuple[int, int]) -> Mask:
    pixels = np.ascontiguousarray(mask, dtype=bool).view(np.uint8)
    square = np.ones(size, dtype=np.uint8)
    result = filter_(pixels, square, anchor=anchor, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(result).view(np.bool_)
