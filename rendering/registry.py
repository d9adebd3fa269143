"""Renderers by name."""

import logging
from collections.abc import Callable
from pathlib import Path

from ..formats.core.errors import InputError, UnknownNameError, check_name
from ..formats.scene.bundle import SceneBundle
from ..formats.splats.store import has_splats
from .embree import SceneRenderer
from .gl.probe import graphics_card, why_no_gl
from .gl.renderer import GlRenderer
from .interface import Renderer
from .splat import SplatDepthRenderer, SplatRenderer

RENDERERS: dict[str, Callable[[SceneBundle, str], Renderer]] = {
    "embree": SceneRenderer,
    "gl": GlRenderer,
    "splat": SplatRenderer,
    "splat_depth": SplatDepthRenderer,
}
AUTO = "auto"

log = logging.getLogger(__name__)


def chosen_renderer(name: str) -> str:
    """Return the name of the renderer to use; `auto` means `gl` if there is a graphics card.

    Raises:
        UnknownNameError: neither `auto` nor a renderer; the message lists the valid names.
        InputError: `gl`, but OpenGL does not work on this machine; the message says why.
    """
    if name == AUTO:
        card = graphics_card()
        log.info("renderer: %s", f"gl on {card}" if card else "embree, no graphics card found")
        return "gl" if card else "embree"
    if name not in RENDERERS:
        raise UnknownNameError("renderer", name, [*RENDERERS, AUTO])
    if name == "gl" and (reason := why_no_gl()):
        raise InputError(f"renderer gl: {reason}; valid here: embree")
    return name


def scene_renderer_name(scene: Path, name: str = AUTO) -> str:
    """Return the name of the renderer to use in a repaired scene; `auto` means `splat` if it can.

    Raises:
        UnknownNameError: as `chosen_renderer`.
        InputError: as `chosen_renderer`.
    """
    return SplatRenderer.name if name == AUTO and has_splats(scene) else chosen_renderer(name)


def make_renderer(bundle: SceneBundle, name: str = "embree", *, light: str = "baked") -> Renderer:
    """Build the renderer `name` for a scene under a light; it takes seconds, so reuse it.

    Raises:
        UnknownNameError: no such renderer or light; the message lists the valid names.
        FileFormatError: the scene's mesh or a texture cannot be read.
        InputError: `gl`, but no OpenGL context can be created, or `splat`, but the scene has no
            splats or the light is not baked; the message says why.
    """
    check_name("renderer", name, RENDERERS)
    return RENDERERS[name](bundle, light)
