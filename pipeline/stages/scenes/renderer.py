"""The renderer of a scene, kept by each worker for the items that follow."""

from pathlib import Path

from ....formats.scene.bundle import INDEX_NAME, SceneBundle, load_bundle
from ....formats.splats.store import has_splats
from ....rendering.interface import Renderer
from ....rendering.registry import make_renderer

# The last one; a scene that is repaired again at its path has an index of another time.
_cache: dict[tuple[Path, str, str, int], tuple[SceneBundle, Renderer]] = {}


def scene_renderer(
    scene: Path, name: str = "", light: str = "baked"
) -> tuple[SceneBundle, Renderer]:
    """Return a repaired scene and its renderer; each worker keeps the last one, slow to load.

    Without a name it is `splat` in scenes of splats, else `embree`.
    """
    name = name or ("splat" if has_splats(scene) else "embree")
    index = scene / INDEX_NAME
    key = scene, name, light, index.stat().st_mtime_ns if index.is_file() else 0
    if (found := _cache.get(key)) is None:
        _cache.clear()  # first: two scenes at once may not fit into memory
        bundle = load_bundle(scene)
        found = _cache[key] = bundle, make_renderer(bundle, name, light=light)
    return found
