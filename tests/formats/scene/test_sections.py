"""Caps of cut solids: exact for closed solids, nothing for what is open or inside out."""

from typing import Any

import numpy as np
import pytest
import trimesh

from tests.support.scenes import scans
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.formats.scene.sections import inside_solids

GRID = GridSpec((-1.0, -1.0), 0.02, 350, 400)


def cut(parts: list[trimesh.Trimesh], z: float = 1.0) -> np.ndarray:
    mesh: Any = trimesh.util.concatenate(parts)
    return inside_solids(mesh.vertices, mesh.faces, z, GRID)


def area(parts: list[trimesh.Trimesh]) -> float:
    return float(cut(parts).sum()) * GRID.cell_m**2


def test_walls_are_solid_and_rooms_are_not() -> None:
    walls = scans.walls((0.0, 0.0), (5.0, 4.0))
    solid = cut(walls)
    inside = GRID.cell_of(np.array([2.0, 2.0]))
    assert not solid[tuple(inside)]
    assert solid[tuple(GRID.cell_of(np.array([-0.05, 2.0])))]
    assert area(walls) == pytest.approx(2 * 5.2 * 0.1 + 2 * 4.0 * 0.1, rel=0.05)


@pytest.mark.parametrize("degrees", [0.0, 17.0, 45.0, 80.0])
def test_turned_walls_without_bottom(degrees: float) -> None:
    box = scans.box((0.0, 0.0, 0.0), (3.0, 0.2, 2.6))
    box.update_faces(np.abs(box.face_normals[:, 2]) < 0.5)
    box.apply_transform(trimesh.transformations.rotation_matrix(np.deg2rad(degrees), [0, 0, 1]))
    assert area([box]) == pytest.approx(0.6, rel=0.1)


def test_open_and_inverted_surfaces_have_no_inside() -> None:
    inverted = scans.box((0.0, 0.0, 0.0), (5.0, 4.0, 2.6))
    inverted.invert()
    assert not cut([inverted]).any()
    open_ = scans.box((0.0, 0.0, 0.0), (3.0, 2.0, 2.6))
    open_.update_faces(open_.face_normals[:, 0] < 0.5)
    assert not cut([open_]).any()
