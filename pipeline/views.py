"""Views that a user names on the command line."""

from __future__ import annotations

from ..collectors.rendering.camera.views import CameraOverrides, View, parse_views
from ..collectors.rendering.light.lights import LIGHTS
from ..collectors.rendering.registry import chosen_renderer
from ..collectors.robots import RobotSpec
from ..formats.core.errors import UnknownNameError

ALL = "all"


def chosen_lights(text: str) -> list[str]:
    """Light names from `DL5000,CL` or `all`, each once.

    Raises:
        UnknownNameError: there is no such light; the message lists the valid names.
    """
    names = sorted(LIGHTS) if text == ALL else [part.strip() for part in text.split(",")]
    for name in names:
        if name not in LIGHTS:
            raise UnknownNameError("light", name, [*LIGHTS, ALL])
    return list(dict.fromkeys(names))


def chosen_views(
    camera: str, light: str, renderer: str, robot: str | RobotSpec, wishes: CameraOverrides
) -> list[View]:
    """Every camera in `camera` under every light in `light`.

    Raises:
        UnknownNameError: no such camera, light, renderer or robot; the message lists valid names.
        InputError: a camera that cannot be read, or `gl` where nothing can be drawn with it.
    """
    drawn_by = chosen_renderer(renderer)
    return [
        view
        for name in chosen_lights(light)
        for view in parse_views(camera, robot, wishes, light=name, renderer=drawn_by)
    ]
