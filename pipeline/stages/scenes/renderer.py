"""The renderer of a scene, kept by each worker for the items that follow."""

from functools import lru_cache
from pathlib import Path

from ....formats.scene.bundle import SceneBundle, load_bundle
from ....formats.splats.store import has_splats
from ....rendering.interface import Renderer
from ....rendering.registry import make_renderer


def scene_renderer(
    scene: Path, name: str = "", light: str = "baked"
) -> tuple[SceneBundle, Renderer]:
    """Return a repaired scene and its renderer; each worker keeps the last one, slow to load.

    Without a name it is `splat` in scenes of splats, else `embree`.
    """
    return _kept(scene, name or ("splat" if has_splats(scene) else "embree"), light)


@lru_cache(maxsize=1)
def _kept(scene: Path, name: str, light: str) -> tuple[SceneBundle, Renderer]:
    bundle = load_bundle(scene)
    return bundle, make_renderer(bundle, name, light=light)
