"""Renderers by name."""

from __future__ import annotations

from collections.abc import Callable

from ...formats.errors import UnknownNameError
from ...formats.scene_bundle import SceneBundle
from .embree import SceneRenderer
from .interface import Renderer

RENDERERS: dict[str, Callable[[SceneBundle, str], Renderer]] = {"embree": SceneRenderer}


def make_renderer(bundle: SceneBundle, name: str = "embree", light: str = "baked") -> Renderer:
    """Build the renderer `name` for a scene under a light; seconds for a house, so keep it.

    Raises:
        UnknownNameError: no such renderer or light; the message lists the valid names.
        FileFormatError: the scene's mesh or a texture cannot be read.
    """
    if name not in RENDERERS:
        raise UnknownNameError("renderer", name, RENDERERS)
    return RENDERERS[name](bundle, light)
