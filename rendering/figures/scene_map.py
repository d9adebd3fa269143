"""A level from above without its ceiling, and the mapping of world points to the picture."""

from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import U8
from ...formats.core.camera import CameraModel
from ...formats.core.frames import matrix_to_quat
from ...formats.scene.bundle import SceneBundle
from ...formats.scene.grid import GridSpec
from ...formats.scene.sections import inside_solids
from ..camera.views import DOWN
from ..interface import Renderer

# So far that the top of a wall shifts by less than 1 cm at 5 m from the centre.
HEIGHT_M = 1000.0
CUT_M = 1.9
MARGIN_M = 0.4
MAX_SIDE_PX = 2000
PAPER = 250
# Fills the cut walls of a CAD model.
CUT_RGB = (62, 66, 77)


@dataclass(frozen=True)
class SceneMap:
    """Picture of a level from above, +y up.

    Attributes:
        image: (H, W, 3) uint8 sRGB; blank where nothing is.
        left_m: world x of the picture's left border [m].
        top_m: world y of the picture's upper border [m].
        px_per_m: scale.
    """

    image: U8
    left_m: float
    top_m: float
    px_per_m: float


def top_down_map(
    bundle: SceneBundle, renderer: Renderer, level: int = 0, px_per_m: float = 50.0
) -> SceneMap:
    """Render a level from above, cut at `CUT_M` above its floor.

    Args:
        bundle: the scene.
        renderer: renderer of that scene.
        level: index of the level.
        px_per_m: scale; reduced if a side would exceed `MAX_SIDE_PX`.

    Raises:
        ValueError: no such level, or the level has no floor.
    """
    floor = bundle.floor(level)
    cells = np.argwhere(floor.covered)
    if not len(cells):
        raise ValueError(f"level {level} of {bundle.scene_id} has no floor to map")
    half = 0.5 * floor.grid.cell_m + MARGIN_M
    lower = floor.grid.center_of(cells.min(0)) - half
    upper = floor.grid.center_of(cells.max(0)) + half
    scale = min(px_per_m, MAX_SIDE_PX / float((upper - lower).max()))
    width, height = (int(side) for side in np.ceil((upper - lower) * scale))
    center = 0.5 * (lower + upper)
    floor_z = bundle.level_floor_z_m[level]
    # At a distance of HEIGHT_M, a pixel spans 1 / scale.
    camera = CameraModel(
        "map", width, height, float(2 * np.rad2deg(np.arctan(0.5 * width / scale / HEIGHT_M)))
    )
    image, depth = renderer.render(
        camera,
        [*center, floor_z + HEIGHT_M],
        matrix_to_quat(DOWN),
        cut_above_m=floor_z + CUT_M,
    )
    image[depth <= 0] = PAPER
    visual = bundle.visual()
    pixels = GridSpec(
        tuple((center - 0.5 * np.array([width, height]) / scale).tolist()), 1 / scale, height, width
    )
    solid = inside_solids(visual.vertices, visual.faces, floor_z + CUT_M, pixels)
    solid &= ~bundle.freemap(level).traversable_on(pixels)
    image[solid[::-1]] = CUT_RGB
    corner = center + np.array([-0.5 * width, 0.5 * height]) / scale
    return SceneMap(image, float(corner[0]), float(corner[1]), scale)
