"""The exact geometry of a building as a scan: what the reader and the repair make of it."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.scene_repair.verify.test_open_sky import share_and_doubts
from tests.support.scenes.homes import exact_freemap
from vlnpe.apartments import build_scene, building_config, generate_exact
from vlnpe.rendering.scene.arrays import scene_arrays
from vlnpe.rendering.scene.textures import load_materials
from vlnpe.scene_repair.config import RepairConfig
from vlnpe.scene_repair.repair import repair_scene

pytestmark = pytest.mark.chain

SEED = 5


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("exact")
    assert generate_exact(SEED, out) == out / "scan.glb"
    return out


def test_nodes_have_exactly_the_bounds_of_their_labels(folder: Path) -> None:
    content = json.loads((folder / "scan.labels.json").read_text())
    boxes = {o["name"]: (o["lower"], o["upper"]) for o in content["objects"]}
    scene = trimesh.load_scene(folder / "scan.glb", process=False)
    # trimesh names the primitives of a mesh with several materials Name, Name_1, ….
    bounds_of: dict[str, list] = {}
    for node in scene.graph.nodes_geometry:
        geometry = scene.geometry[str(scene.graph[node][1])]
        name = max((n for n in boxes if str(node).startswith(n)), key=len)
        bounds_of.setdefault(name, []).append(geometry.bounds)
    assert len(bounds_of) > 100
    for name, bounds in bounds_of.items():
        lower, upper = np.min([b[0] for b in bounds], 0), np.max([b[1] for b in bounds], 0)
        np.testing.assert_allclose([lower, upper], boxes[name], atol=1e-4, err_msg=name)


def test_the_repair_finds_the_exact_floor_and_leaves_doorways_open(
    folder: Path, tmp_path: Path
) -> None:
    bundle = repair_scene(folder / "scan.glb", tmp_path, RepairConfig(scene_id="exact"))
    assert json.loads((tmp_path / "repair.json").read_text())["verification"]["sound"]
    assert share_and_doubts(bundle) == (0.0, [])  # its ceilings are there
    # An object with several materials is one object, not one per material.
    labels = json.loads((folder / "scan.labels.json").read_text())["objects"]
    assert {o.name for o in bundle.objects} <= {o["name"] for o in labels}
    assert {"Sofa_1", "Bed_1"} <= {o.name for o in bundle.objects}
    home = build_scene(np.random.default_rng(SEED), building_config("apartment"), painted=False)
    truth, freemap = exact_freemap(home), bundle.freemap(0)
    rows, columns = np.nonzero(truth.free(0.3))
    xy = truth.grid.center_of(np.stack([rows, columns], -1))
    cells = freemap.grid.cell_of(xy)
    free = freemap.free(0.25)[cells[:, 0], cells[:, 1]]
    assert free.mean() > 0.99
    # No collision box fills a doorway: each centre of one is clear of all boxes.
    boxes = bundle.obstacles(0)
    low, high = boxes.center_m - boxes.half_m, boxes.center_m + boxes.half_m
    for door in (o for o in home.plan.openings if o.kind in ("door", "passage")):
        room = home.plan.rooms[door.room]
        middle = np.empty(3)
        middle[door.axis] = room.wall_at(door.axis, door.sign) + door.sign * 0.06
        middle[1 - door.axis], middle[2] = (door.start_m + door.end_m) / 2, 0.5
        assert not np.any(np.all((middle > low) & (middle < high), axis=1))
    # Its textures are surface colours, which the renderer lights.
    arrays = scene_arrays(bundle.visual(), load_materials(bundle))
    assert arrays.shaded.all()
