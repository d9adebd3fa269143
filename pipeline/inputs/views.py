"""Views that a user names on the command line."""

from ...collectors.robots import RobotSpec
from ...formats.core.errors import InputError, check_name
from ...formats.core.rollout import STATE_RATE_HZ
from ...rendering.camera.views import CameraOverrides, View, parse_views
from ...rendering.light.lights import LIGHTS
from ...rendering.registry import AUTO, chosen_renderer
from .crews import ALL, listed_names


def chosen_lights(text: str) -> list[str]:
    """Return the light names of `DL5000,CL` or `all`, each once."""
    names = listed_names("--light", text, sorted(LIGHTS))
    for name in names:
        check_name("light", name, (*LIGHTS, ALL))
    return names


def chosen_views(
    camera: str, light: str, renderer: str, robot: RobotSpec, overrides: CameraOverrides
) -> list[View]:
    """Return every camera in `camera` under every light in `light`."""
    # What `auto` means is up to each scene: see `scene_renderer_name`.
    drawn_by = AUTO if renderer == AUTO else chosen_renderer(renderer)
    return [
        view
        for name in chosen_lights(light)
        for view in parse_views(camera, robot, overrides, light=name, renderer=drawn_by)
    ]


def check_frame_rate(rate: int) -> None:
    """Raise InputError if `rate` does not divide the state rate."""
    if rate < 1 or STATE_RATE_HZ % rate:
        raise InputError(f"--frames-per-second {rate}: valid: 4, 5, 10, 20, 25, 50")
