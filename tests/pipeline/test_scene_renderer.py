"""A worker's renderer of a scene is loaded once, and again after the scene has changed."""

from pathlib import Path

import numpy as np

from tests.support.scenes.rooms import write_two_rooms
from vlnpe.formats.core.camera import CameraModel
from vlnpe.formats.scene.bundle import INDEX_NAME
from vlnpe.pipeline.stages.scenes.renderer import scene_renderer


def depth_below_m(scene: Path) -> float:
    """Depth of the floor in the middle of an image from 1 m above it, the camera looking down."""
    frame = scene_renderer(scene)[1].render_labelled(
        CameraModel("down", 9, 9, 60.0), np.array([1.0, 1.0, 1.0]), np.array([0.0, 1.0, 0.0, 0.0])
    )
    return float(frame.depth_m[4, 4])


def test_a_scene_repaired_again_at_its_path_is_drawn_anew(tmp_path: Path) -> None:
    write_two_rooms(tmp_path / "scene")
    scene = tmp_path / "scene"
    assert np.isclose(depth_below_m(scene), 1.0, atol=0.01)
    assert scene_renderer(scene)[1] is scene_renderer(scene)[1]
    visual = dict(np.load(scene / "visual.npz"))
    visual["vertices"] -= np.array([0.0, 0.0, 0.5], dtype=np.float32)
    np.savez(scene / "visual.npz", **visual)
    index = scene / INDEX_NAME
    index.write_bytes(index.read_bytes())
    assert np.isclose(depth_below_m(scene), 1.5, atol=0.01)
