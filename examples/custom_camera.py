"""Look at a scene through any camera: python examples/custom_camera.py SCENE OUT.png."""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from vlnpe.formats.core.camera import CameraModel
from vlnpe.formats.core.frames import matrix_to_quat
from vlnpe.formats.scene.bundle import load_bundle
from vlnpe.rendering.registry import make_renderer


def main(scene: Path, out: Path, position_world_m: tuple[float, float, float]) -> None:
    camera = CameraModel("wide", width_px=160, height_px=120, hfov_deg=100.0)
    # Optical axes (x right, y down, z forward) as columns, in world axes: it looks along +x.
    optical_to_world = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    renderer = make_renderer(load_bundle(scene))
    rgb, depth_m = renderer.render(
        camera, np.array(position_world_m), matrix_to_quat(optical_to_world)
    )
    Image.fromarray(rgb).save(out)
    print(f"{out}: centre {depth_m[60, 80]:.2f} m away")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), (1.0, 2.0, 1.2))
