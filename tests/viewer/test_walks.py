"""The list of walks: filters, outliers, poses, text parts; simplified scenes."""

import shutil
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

pytest.importorskip("viser", reason="the extra `view` is not installed")

import mujoco
from viser import GaussianSplatHandle

from tests.viewer.test_page import make_entry, make_walk
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.core.flags import FLAGS_NAME, FlagFile
from vlnpe.formats.scene.bundle import VisualMesh
from vlnpe.formats.splats.record import GaussianCloud
from vlnpe.formats.splats.store import save_splats
from vlnpe.pipeline.engine.ledger import Row
from vlnpe.pipeline.stages.datasets.export_items import rows_to_export
from vlnpe.rendering.scene.robot_body import RobotBody
from vlnpe.viewer.cache import MOST, cached, stamp
from vlnpe.viewer.layers import SceneView
from vlnpe.viewer.library import Choice, chosen, outlier_scores, table_html
from vlnpe.viewer.scene import WHITE_GAIN, Detail, add_scene, before_tone_mapping, simplified
from vlnpe.viewer.server import LocalServer


def test_links_stand_where_the_renderer_draws_them():
    walk = make_walk("aliengo/path/ep0")
    position, _, feet = walk.poses
    body = RobotBody(walk.model, walk.rollout.joint_names)
    k = 321
    body.pose(
        walk.rollout.position_world_m[k],
        walk.rollout.quat_wxyz[k],
        walk.rollout.joint_position_rad[k],
    )
    trunk = walk.rollout.position_world_m[k]
    np.testing.assert_allclose(position[k, 0], trunk, atol=1e-4)
    sole = [body._data.site(foot).xpos for foot in walk.rollout.foot_names]
    np.testing.assert_allclose(feet[k], sole, atol=1e-5)
    assert isinstance(walk.model, mujoco.MjModel)


def test_filters_and_orders():
    entries = [make_entry(f"aliengo/path/ep{k}", k % 2, 5.0 + 0.1 * k) for k in range(9)]
    entries.append(make_entry("h1/speed/ep9", 0, 40.0))
    assert [e.name for e in chosen(entries, Choice(robot="h1"), ())] == ["h1/speed/ep9"]
    assert len(chosen(entries, Choice(touched=True), ())) == 4
    assert len(chosen(entries, Choice(length_m=(5.0, 5.45)), ())) == 5
    assert chosen(entries, Choice(flagged=True), {"aliengo/path/ep3"})[0].name == "aliengo/path/ep3"
    assert chosen(entries, Choice(order="outliers first"), ())[0].robot == "h1"
    scores = outlier_scores(entries)
    assert scores["h1/speed/ep9"] > 3.5 > scores["aliengo/path/ep4"]
    assert "&lt;b&gt;" in table_html([make_entry("a/b/<b>")], (), "")


def test_a_flag_taken_back_is_none_and_a_broken_line_is_named(tmp_path):
    flags = FlagFile(tmp_path)
    assert flags.flagged() == {}
    flags.set("a/b/c", True, "limps")
    flags.set("a/b/d", True)
    flags.set("a/b/d", False)
    assert FlagFile(tmp_path).flagged() == {"a/b/c": "limps"}
    with (tmp_path / FLAGS_NAME).open("a") as stream:
        stream.write("{}\n")
    with pytest.raises(FileFormatError, match="line 4"):
        flags.flagged()


def test_an_export_without_flagged_walks_leaves_them_out_of_every_view(tmp_path):
    names = [f"aliengo/path/{view}/ep{k}" for view in ("ego", "top") for k in (1, 2)]
    row = partial(Row, "render", key="", status="done", failed=False, outputs=(), seconds=0.0)
    rows = {name: row(name, facts={"end_reason": "success"}) for name in names}
    FlagFile(tmp_path).set("aliengo/path/ep1", True)
    left = rows_to_export(rows, False, FlagFile(tmp_path).flagged())
    assert list(left) == ["aliengo/path/ego/ep2", "aliengo/path/top/ep2"]
    assert rows_to_export(rows, True) == rows


def test_the_browser_shows_greys_as_they_are():
    srgb = np.linspace(0, 1, 11)
    stored = before_tone_mapping(srgb)
    linear = np.where(stored <= 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4)
    x = linear * WHITE_GAIN / 0.6  # three.js: exposure, then the fit of RRT and ODT
    y = (x * (x + 0.0245786) - 0.000090537) / (x * (0.983729 * x + 0.4329510) + 0.238081)
    shown = np.where(y <= 0.0031308, 12.92 * y, 1.055 * np.clip(y, 0, 1) ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(shown, 0.955 * srgb, atol=0.015)


def test_splats_are_shown_as_splats_the_least_visible_left_out(two_rooms, tmp_path):
    rng = np.random.default_rng(0)
    count = 900
    scale = np.full((count, 3), 0.02, np.float32)
    scale[:300] = 0.2
    cloud = GaussianCloud(
        position=rng.uniform(0, 3, (count, 3)).astype(np.float32),
        scale=scale,
        quat_wxyz=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        opacity=np.full(count, 0.9, np.float32),
        harmonics=np.zeros((count, 1, 3), np.float32),
    )
    shutil.copytree(two_rooms.root, tmp_path, dirs_exist_ok=True)
    bundle = replace(two_rooms, root=tmp_path)
    save_splats(tmp_path, cloud)
    server = LocalServer("splats")
    try:
        nodes = add_scene(server.scene, bundle, detail=Detail(splats=300))
        splats = nodes.lower[0]
        assert isinstance(splats, GaussianSplatHandle)
        kept = splats.buffer.view(np.float32)[:, :3]
        np.testing.assert_allclose(np.sort(kept[:, 0]), np.sort(cloud.position[:300, 0]), atol=1e-6)
        assert server.request_share_url() is None  # no tunnel to the internet
        nodes.show(0)
        assert nodes.lower[0].visible
        nodes.show(1)  # the splats of all levels are one node
        assert nodes.lower[0].visible
        view = SceneView(server, bundle)
        assert isinstance(view._scene.lower[0], GaussianSplatHandle)
    finally:
        server.stop()


def test_a_simplified_mesh_keeps_its_shape_and_texture():
    n = 60
    y, x = np.mgrid[0 : n + 1, 0 : n + 1].astype(np.float32) / n
    vertices = np.column_stack([4 * x.ravel(), 4 * y.ravel(), 0 * x.ravel()]).astype(np.float32)
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    faces = np.concatenate(
        [np.column_stack([a, a + 1, a + n + 2]), np.column_stack([a, a + n + 2, a + n + 1])]
    ).astype(np.int32)
    uv = vertices[:, :2] / 4
    none = np.full(len(faces), -1, np.int32)
    mesh = VisualMesh(vertices, faces, uv[faces].astype(np.float32), np.zeros_like(none), none)
    small = simplified(mesh, 500)
    assert len(small.faces) < 700
    corners = small.vertices[small.faces]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    assert area.sum() / 2 == pytest.approx(16.0, rel=0.01)
    np.testing.assert_allclose(small.corner_uv, corners[..., :2] / 4, atol=0.02)


def test_what_was_prepared_is_kept_unless_it_is_damaged_or_old(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    parts, made = {"0/lower": b"glb", "0/upper": b""}, []

    def make() -> dict[str, bytes]:
        made.append(1)
        return parts

    assert cached("a scene", make) == cached("a scene", make) == parts
    assert len(made) == 1
    (file,) = tmp_path.rglob("*.npz")
    file.write_bytes(file.read_bytes()[:-30])
    assert cached("a scene", make) == parts and len(made) == 2
    for number in range(MOST + 2):
        cached(str(number), make)
    assert len(list(tmp_path.rglob("*.npz"))) == MOST


def test_a_scene_written_again_is_prepared_again(two_rooms, tmp_path):
    shutil.copytree(two_rooms.root, tmp_path, dirs_exist_ok=True)
    before = stamp(tmp_path)
    assert stamp(tmp_path) == before
    (tmp_path / "scene.json").touch()
    assert stamp(tmp_path) != before
