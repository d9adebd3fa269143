"""The page of a repaired scene: before and after, holes with their reasons, levels, maps."""

import html
from dataclasses import replace
from typing import Any

import mapbox_earcut
import numpy as np
import viser

from ..formats.core.arrays import Array, Mask
from ..formats.scene.bundle import SceneBundle, VisualMesh
from ..formats.scene.grid import GridSpec
from ..formats.splats.store import SPLATS_NAME
from ..formats.untrusted.documents import read_json_object
from .panel import padded
from .scene import Detail, add_scene

FILLED, LEFT = (40, 170, 80), (220, 50, 50)
LIFT_M = 2.0  # from which the slider lays the patches, above their holes
MOST_HOLES = 150  # the largest
OVER_FLOOR_M = 0.02
FREE, BLOCKED = (60, 140, 255), (150, 60, 60)


class SceneView:
    """A repaired scene on a server."""

    def __init__(
        self, server: viser.ViserServer, bundle: SceneBundle, detail: Detail | None = None
    ):
        """Add the scene, its layers and their controls.

        Raises:
            FileFormatError: a file of the scene is missing or damaged.
        """
        self.server, self.bundle = server, bundle
        report = bundle.root / "repair.json"
        self._repair = read_json_object(report) if report.is_file() else {}
        before = int(self._repair.get("triangles_before") or 0)
        mesh = bundle.visual()
        patched = (
            np.arange(len(mesh.faces)) >= before if before else np.zeros(len(mesh.faces), bool)
        )
        splats = (bundle.root / SPLATS_NAME).is_file()  # shown as such; only patches are triangles
        part = None if splats else _part(mesh, ~patched)
        self._scene = add_scene(server.scene, bundle, detail=detail, mesh=part)
        self._patches = server.scene.add_frame("/patches", show_axes=False)
        self._patched = bool(patched.any())
        if self._patched:
            part = _part(mesh, patched)
            add_scene(server.scene, bundle, "/patches/floor", detail, part).show(ceiling=True)
        self._holes: list[tuple[int, bool, Any]] = []
        self._maps: list[tuple[int, str, Any]] = []
        for level in range(len(bundle.level_floor_z_m)):
            self._add_holes(level)
            self._add_maps(level)
        self._look(mesh)
        self._add_controls()
        self._update()

    def _add_holes(self, level: int) -> None:
        levels = self._repair.get("levels") or []
        holes = levels[level].get("holes", []) if level < len(levels) else []
        holes = sorted(holes, key=lambda hole: -float(hole["area_m2"]))[:MOST_HOLES]
        z = self.bundle.level_floor_z_m[level] + OVER_FLOOR_M
        for k, hole in enumerate(holes):
            filled = hole["action"] == "filled"
            points, faces = _flat(hole["polygons_xy_m"], z)
            if not len(faces):
                continue
            node = self.server.scene.add_mesh_simple(
                f"/holes/{level}/{k}",
                points,
                faces,
                color=FILLED if filled else LEFT,
                opacity=0.45,
                side="double",
                cast_shadow=False,
                receive_shadow=False,
            )
            node.on_click(lambda _, hole=hole: self._tell(hole))
            self._holes.append((level, filled, node))

    def _add_maps(self, level: int) -> None:
        scene, z = self.server.scene, self.bundle.level_floor_z_m[level] + 0.5 * OVER_FLOOR_M
        freemap = self.bundle.freemap(level)
        points, faces = _cells(freemap.grid, freemap.traversable, z)
        if len(faces):
            free = scene.add_mesh_simple(
                f"/map/{level}/free", points, faces, color=FREE, opacity=0.4, side="double",
                cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
            self._maps.append((level, "free", free))
        boxes = self.bundle.obstacles(level)
        if len(boxes.center_m):
            points, faces = _cube()
            quats = np.tile([1.0, 0, 0, 0], (len(boxes.center_m), 1))
            node = scene.add_batched_meshes_simple(
                f"/map/{level}/obstacles", points, faces, quats, boxes.center_m,
                batched_scales=boxes.half_m, batched_colors=BLOCKED, opacity=0.5,
                cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
            self._maps.append((level, "obstacles", node))

    def _add_controls(self) -> None:
        gui, count = self.server.gui, len(self.bundle.level_floor_z_m)
        gui.main_panel.dock_right()
        self._after = gui.add_slider(
            "Before ↔ after", 0.0, 1.0, 0.02, 1.0, disabled=not self._patched
        )
        self._level = gui.add_dropdown("Level", ("all", *map(str, range(count))))
        boxes = ("Filled holes", False), ("Holes left open", True), ("Free map", False)
        self._boxes = {
            label: gui.add_checkbox(label, on)
            for label, on in (*boxes, ("Obstacles", False), ("Ceilings", False))
        }
        gui.add_html(padded("Click a coloured patch for its reason."))
        self._reason = gui.add_html("")
        for handle in (self._after, self._level, *self._boxes.values()):
            handle.on_update(lambda _: self._update())
        gui.add_html(_summary(self._repair))

    def _update(self) -> None:
        level = None if self._level.value == "all" else int(self._level.value)
        on = {label: box.value for label, box in self._boxes.items()}
        with self.server.atomic():
            self._scene.show(level, ceiling=on["Ceilings"])
            self._patches.visible = self._after.value > 0
            self._patches.position = (0.0, 0.0, LIFT_M * (1 - self._after.value))
            for at, filled, node in self._holes:
                shown = on["Filled holes" if filled else "Holes left open"]
                node.visible = shown and level in (None, at)
            for at, kind, node in self._maps:
                shown = on["Free map" if kind == "free" else "Obstacles"]
                node.visible = shown and level in (None, at)

    def _tell(self, hole: dict[str, Any]) -> None:
        self._reason.content = hole_html(hole)

    def _look(self, mesh: VisualMesh) -> None:
        low, high = mesh.vertices.min(0), mesh.vertices.max(0)
        middle, size = (low + high) / 2, float(np.linalg.norm((high - low)[:2]))
        camera = self.server.initial_camera
        camera.look_at = tuple(middle)
        camera.position = tuple(middle + size * np.array([0.0, -0.55, 0.75]))


def hole_html(hole: dict[str, Any]) -> str:
    """Return what was done with a hole, and why."""
    area, words = float(hole["area_m2"]), [str(hole["action"]), str(hole.get("cause", ""))]
    reason = html.escape(str(hole.get("reason", "")))
    title = html.escape(" · ".join(filter(None, words)))
    return padded(f"<b>{title}</b>, {area:.3f} m²<br>{reason}", announced=True)


def _summary(repair: dict[str, Any]) -> str:
    rows = []
    for number, level in enumerate(repair.get("levels") or []):
        holes = level.get("holes", [])
        filled = sum(h["action"] == "filled" for h in holes)
        rows.append(
            f"<tr><td>{number}</td><td>{level['floor_area_before_m2']:.1f} m²</td>"
            f"<td>{level['floor_area_after_m2']:.1f} m²</td><td>{filled}</td>"
            f"<td>{len(holes) - filled}</td></tr>"
        )
    heads = "".join(
        f"<th scope='col'>{h}</th>" for h in ("level", "before", "after", "filled", "left")
    )
    table = f"<table style='border-spacing:0.6em 0'><tr>{heads}</tr>{''.join(rows)}"
    doubts = [*(repair.get("doubts") or []), *(repair.get("warnings") or [])]
    lines = "".join(f"<li>{html.escape(str(d))}</li>" for d in doubts)
    return padded(f"{table}</table><ul>{lines}</ul>")


def _part(mesh: VisualMesh, chosen: Mask) -> VisualMesh:
    """Return some of a mesh's faces."""
    names = ("faces", "corner_uv", "face_material", "face_label", "face_object")
    return replace(mesh, **{name: getattr(mesh, name)[chosen] for name in names})


def _flat(polygons: list[Any], z: float) -> tuple[Array, Any]:
    """Return the triangles of horizontal polygons: the first is the outline, others its holes."""
    rings = [np.asarray(ring, np.float64).reshape(-1, 2) for ring in polygons if len(ring) >= 3]
    if not rings:
        return np.empty((0, 3)), np.empty((0, 3), np.uint32)
    points = np.concatenate(rings)
    ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
    faces = mapbox_earcut.triangulate_float64(points, ends).reshape(-1, 3)
    return np.column_stack([points, np.full(len(points), z)]), faces


def _cells(grid: GridSpec, chosen: Mask, z: float) -> tuple[Array, Any]:
    """Return two triangles per run of chosen cells in a row."""
    edge = np.diff(np.pad(chosen.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    row, first = np.nonzero(edge == 1)
    _, stop = np.nonzero(edge == -1)
    corner = np.asarray(grid.center_of([(0, 0)]))[0] - 0.5 * grid.cell_m
    x0, x1 = corner[0] + first * grid.cell_m, corner[0] + stop * grid.cell_m
    y0 = corner[1] + row * grid.cell_m
    y1 = y0 + grid.cell_m
    corners = np.stack(
        [np.column_stack(xy) for xy in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))], axis=1
    ).reshape(-1, 2)
    base = 4 * np.arange(len(row))[:, None]
    faces = np.concatenate([base + np.array(half) for half in ([0, 1, 2], [0, 2, 3])])
    return np.column_stack([corners, np.full(len(corners), z)]), faces


def _cube() -> tuple[Array, Any]:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return signs, np.array([[q[0], q[i], q[i + 1]] for q in quads for i in (1, 2)])
