"""Draw before and after images: a level from above, ceiling removed, holes marked."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import cv2
import numpy as np

from ...formats.core.arrays import F32, U8, Array, Mask
from ...formats.scene.grid import GridSpec
from ...formats.scene.sections import inside_solids
from ...formats.scene.staircase import Staircase
from ...geometry.rays.packets import PacketScene
from ..floor.holes import Hole
from ..grid.world_mesh import WorldMesh
from ..paint.materials import MaterialSampler

# The cut above the floor: under ceilings and lamps, above furniture and people.
CUT_M = 2.2
BACKGROUND = (0.965, 0.968, 0.975)
RED = (0.86, 0.10, 0.12)
GREEN = (0.05, 0.55, 0.20)
BLUE = (0.10, 0.30, 0.80)
GREY = (0.45, 0.47, 0.52)
CUT = (0.24, 0.26, 0.30)
LEFT = 18  # px beside text
FONT, INK = cv2.FONT_HERSHEY_DUPLEX, (45, 48, 56)
SUPERSCRIPT = 0.6  # size relative to the line's
TITLE, SMALL = 0.62, 0.46  # sizes of the font


def view_from_above(
    mesh: WorldMesh,
    sampler: MaterialSampler,
    floor_z_m: float,
    pixels: GridSpec,
    first_patch: int,
    walked: Mask,
) -> tuple[F32, F32]:
    """Render shaded colours (rows, columns, 3) of a level from above; row 0 = least y.

    Args:
        pixels: one ray per cell.
        first_patch: faces from this one on are patches.
        walked: (rows, columns) pixels where a robot can walk, under lintels for example.

    Returns:
        The picture without the patches (what lies under them shows), and with them.
    """
    scene = PacketScene(mesh.vertices, mesh.faces)
    origin = np.empty((*pixels.shape, 3), dtype=np.float32)
    origin[..., 0] = pixels.center_of([(0, j) for j in range(pixels.columns)])[:, 0]
    origin[..., 1] = pixels.center_of([(i, 0) for i in range(pixels.rows)])[:, 1, None]
    origin[..., 2] = floor_z_m + CUT_M
    origin = origin.reshape(-1, 3)
    after, height = _shoot(scene, mesh, sampler, floor_z_m, origin)
    before, height_before = after.copy(), height.copy()
    through = np.flatnonzero(height[:, 1] >= first_patch)
    origin = origin[through]
    origin[:, 2] = height[through, 0] - 1e-3
    before[through], height_before[through] = _shoot(scene, mesh, sampler, floor_z_m, origin)
    shape = pixels.shape
    # What a wall of a CAD model is filled with has no surface of its own to be seen.
    solid = inside_solids(mesh.vertices, mesh.faces, floor_z_m + CUT_M, pixels) & ~walked
    seen = []
    for colors, heights in ((before, height_before), (after, height)):
        image = _with_edges(colors.reshape(*shape, 3), heights[:, 0].reshape(shape))
        image[solid] = CUT
        seen.append(image)
    return seen[0], seen[1]


def _shoot(
    scene: PacketScene, mesh: WorldMesh, sampler: MaterialSampler, floor_z_m: float, origin: F32
) -> tuple[F32, Array]:
    """Return colours (N, 3), and height and face (N, 2) below each origin; −1 = nothing."""
    image = np.tile(np.array(BACKGROUND, dtype=np.float32), (len(origin), 1))
    hits = np.full((len(origin), 2), -1.0)
    hits[:, 0] = np.nan
    if not len(origin):
        return image, hits
    hit = scene.trace(
        origins=origin,
        directions=np.tile(np.array([0.0, 0.0, -1.0], dtype=np.float32), (len(origin), 1)),
        far=np.full(len(origin), np.inf, dtype=np.float32),
    )
    seen = hit.prim >= 0
    face = hit.prim[seen].astype(np.int64)
    u, v = hit.u[seen], hit.v[seen]
    weights = np.stack([1 - u - v, u, v], axis=1)
    uv = np.einsum("nk,nkd->nd", weights, mesh.corner_uv[face])
    height = origin[seen, 2] - hit.depth[seen]
    # Soft light from the upper left, and what stands higher is a little brighter.
    normal = mesh.normals.astype(np.float32)[face]
    normal = normal * np.where(normal[:, 2:3] < 0, np.float32(-1), np.float32(1))
    light = np.clip(normal @ np.array([-0.35, 0.35, 0.87], dtype=np.float32), 0.0, 1.0)
    lift = np.clip((height - floor_z_m) / CUT_M, 0.0, 1.0).astype(np.float32)
    shade = 0.62 + 0.34 * light + 0.10 * lift
    color = sampler.at(mesh.face_material[face], uv)
    image[seen] = np.clip(color * shade[:, None], 0.0, 1.0)
    hits[seen, 0], hits[seen, 1] = height, face
    return image, hits


def _with_edges(image: F32, height: Array) -> F32:
    """Darken pixels where the height jumps: contours make furniture and walls readable."""
    filled = np.where(np.isfinite(height), height, -1.0)
    step = np.zeros_like(filled)
    step[:, 1:] = np.abs(np.diff(filled, axis=1))
    step[1:] = np.maximum(step[1:], np.abs(np.diff(filled, axis=0)))
    strength = np.clip((step - 0.05) / 0.4, 0.0, 1.0)[..., None] * 0.55
    return (image * (1 - strength)).astype(np.float32)


def is_shown(hole: Hole) -> bool:
    """Return whether pictures mark a gap; those under walls and outside never had a floor."""
    return hole.fill or hole.cause not in ("wall", "outside")


def mark_holes(
    image: F32, holes: list[Hole], *, fine: GridSpec, pixels: GridSpec, before: bool
) -> F32:
    """Overlay `is_shown` holes: hatched red before, outlined green after, grey if left open."""
    number = np.zeros(fine.shape, dtype=np.uint8)
    for hole in holes:
        if is_shown(hole):
            number[hole.window][hole.cells] = 1 if hole.fill else 2
    under = zip(fine.under(pixels), fine.shape, strict=True)
    kind = number[np.ix_(*(np.clip(cell, 0, n - 1) for cell, n in under))]
    i, j = np.ogrid[: pixels.rows, : pixels.columns]
    hatch = ((i + j) // 5) % 2 == 0
    result = image.copy()
    for value, color in ((1, RED if before else GREEN), (2, GREY)):
        mask = kind == value
        if before or value == 2:
            strength = np.where(hatch, 0.65, 0.45)[mask][:, None]
            result[mask] = (1 - strength) * result[mask] + strength * np.array(color)
        contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(result, contours, -1, color, 2, cv2.LINE_AA)
    return result


def mark_staircases(image: F32, staircases: Mapping[int, Staircase], pixels: GridSpec) -> F32:
    """Draw an arrow and the number of each staircase, grey where nobody could climb it."""
    # Upright, for the sake of the numbers.
    result = np.ascontiguousarray(image[::-1])
    thick = max(2, _metre_px(pixels) // 25)
    for k, staircase in staircases.items():
        row, column = pixels.cell_of(staircase.line_world_m[1:-1, :2]).T
        points = np.column_stack([column, pixels.rows - 1 - row])
        color = GREY if staircase.problem else BLUE
        cv2.polylines(result, [points[:-1].astype(np.int32)], False, color, thick, cv2.LINE_AA)
        (start, end), beside = points[-2:].tolist(), points[0] + (3 * thick, 0)
        cv2.arrowedLine(result, start, end, color, thick, cv2.LINE_AA, tipLength=0.15)
        cv2.putText(
            result, f"{k}", beside.tolist(), FONT, thick / 3, color, thick // 2, cv2.LINE_AA
        )
    return result[::-1]


def write_picture(
    path: Path,
    views: dict[str, F32],
    pixels: GridSpec,
    title: str,
    legend: list[tuple[str, tuple[float, float, float]]],
    *,
    scale: float,
) -> None:
    """Stack level views (row 0 = least y) under a title line with legend and scale bar.

    Views of several levels get their names written above them. Text is drawn at `scale`, see
    `text_scale`.
    """
    width = pixels.columns
    head = round(64 * scale)
    gap, name_px = 16, round(30 * scale) if len(views) > 1 else 0
    height = head + sum(v.shape[0] for v in views.values()) + (gap + name_px) * len(views)
    canvas = np.full((height, width, 3), BACKGROUND, dtype=np.float32)
    top, names = head, []
    for name, view in views.items():
        names.append((name, top + round(20 * scale)))
        top += name_px
        canvas[top : top + view.shape[0]] = view[::-1]
        top += view.shape[0] + gap
    out = np.clip(np.rint(canvas * 255), 0, 255).astype(np.uint8)
    for name, baseline in names if name_px else ():
        _write(out, name, (round(LEFT * scale), baseline), 0.5 * scale, int(scale))

    def at(x: float, y: float) -> tuple[int, int]:
        return round(scale * x), round(scale * y)

    def line(a: tuple[float, float], b: tuple[float, float]) -> None:
        cv2.line(out, at(*a), at(*b), INK, round(2 * scale), cv2.LINE_AA)

    def write(text: str, x: float, y: float, size: float) -> None:
        _write(out, text, at(x, y), scale * size, int(scale))

    write(title, LEFT, 27, TITLE)
    x = LEFT
    for text, color in legend:
        rgb = [round(255 * c) for c in color]
        cv2.rectangle(out, at(x, 41), at(x + 14, 55), rgb, -1, cv2.LINE_AA)
        write(text, x + 22, 54, SMALL)
        x += _entry_px(text)
    metre = _metre_px(pixels) / scale
    right = width / scale - LEFT
    line((right - metre, 48), (right, 48))
    for end in (right - metre, right):
        line((end, 43), (end, 53))
    write("1 m", right - metre - 40, 53, SMALL)
    cv2.imwrite(str(path), out[..., ::-1])


def text_scale(
    pixels: GridSpec, title: str, legend: list[tuple[str, tuple[float, float, float]]]
) -> float:
    """Return how much larger than in a picture of 620 px text is, as far as it fits."""
    title_px = _width_px(title, TITLE)
    below_px = sum(_entry_px(text) for text, _ in legend) + 60  # and the scale bar with its number
    fitting = (
        pixels.columns / (title_px + 2 * LEFT),
        (pixels.columns - _metre_px(pixels)) / (below_px + 2 * LEFT),
    )
    return max(1.0, min(pixels.columns / 620, *fitting))


def _metre_px(pixels: GridSpec) -> int:
    return max(1, round(1.0 / pixels.cell_m))


def _entry_px(text: str) -> int:
    """Return the width of a legend's entry [px], at scale 1."""
    return 44 + _width_px(text, SMALL)


def _pieces(text: str, size: float) -> Iterator[tuple[str, float, float]]:
    """Yield parts of a text with size and height above the line [px]: the font has no letter ²."""
    for part in re.split("(²)", text):
        raised = part == "²"
        yield ("2", SUPERSCRIPT * size, 11 * size) if raised else (part, size, 0)


def _width_px(text: str, size: float) -> int:
    return sum(cv2.getTextSize(p, FONT, s, 1)[0][0] for p, s, _ in _pieces(text, size))


def _write(out: U8, text: str, place: tuple[int, int], size: float, thickness: int) -> None:
    """Draw a text from its left end on the line, `place` (x, y) [px], into `out` (H, W, 3)."""
    x, y = place
    for part, part_size, raised in _pieces(text, size):
        at = (x, round(y - raised))
        cv2.putText(out, part, at, FONT, part_size, INK, thickness, cv2.LINE_AA)
        x += cv2.getTextSize(part, FONT, part_size, thickness)[0][0]
