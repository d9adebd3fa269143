"""Registry of lights, as the parameters that the shading kernels need."""

from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import F32
from ...formats.core.errors import check_name


@dataclass(frozen=True)
class Light:
    """Lighting of surfaces.

    Under `baked`, a scan's textures already contain the light of the room and are shown unchanged.
    Surfaces of a plain colour would look flat, so they get a mild fixed shading: brighter from
    above than from below (`sky`, `ground`), a soft directional part (`key`) that distinguishes
    walls, and a little light from the viewer (`head`).

    The other lights treat every texture as the surface's own colour and light it by panels under
    the ceilings (see `panels.py`), a lamp on the robot, and ambient light.

    Attributes:
        relit: whether panels and the lamp light the scene; otherwise the room shading does.
        panels: strength of the panel lights; 1 = daylight level on the floor.
        lamp: irradiance of the robot's lamp on a wall 1 m ahead.
        around: ambient light from all open directions.
        sky, ground: irradiance on plain surfaces facing straight up and down.
        key: strength of the directional part.
        key_direction: (3,) direction towards it, world; need not be normalised.
        head: strength of the part that falls off with the angle between surface and view ray.
        corner: how much closed corners are darkened, 0–1 (see `openness.py`).
        outside_up: colour (linear light) where nothing is hit above the horizon: the sky over a
            scene without a ceiling.
        outside_down: colour where nothing is hit at or below the horizon: the dark of a hole.
    """

    name: str
    relit: bool = False
    panels: float = 0.0
    lamp: float = 0.0
    around: float = 0.0
    sky: float = 0.9
    ground: float = 0.6
    key: float = 0.28
    key_direction: tuple[float, float, float] = (0.45, 0.8, 0.4)
    head: float = 0.08
    corner: float = 0.9
    outside_up: tuple[float, float, float] = (0.40, 0.47, 0.56)
    outside_down: tuple[float, float, float] = (0.05, 0.05, 0.055)

    def parameters(self) -> F32:
        """Return (14,) float32: sky, ground, key, head, key direction, outside up, down, corner."""
        direction = np.asarray(self.key_direction) / np.linalg.norm(self.key_direction)
        return np.array(
            [
                self.sky,
                self.ground,
                self.key,
                self.head,
                *direction,
                *self.outside_up,
                *self.outside_down,
                self.corner,
            ],
            dtype=np.float32,
        )


# The scan's own light and the three of VLN-PE's lighting study. `DL300` has 300 / 5000 of the light
# of `DL5000` at the same exposure; the sRGB curve maps these 6 % to about a quarter of the value.
NIGHT = 300 / 5000
NIGHT_SKY, NO_SKY = (0.012, 0.014, 0.022), (0.002, 0.002, 0.003)
LIGHTS: dict[str, Light] = {
    light.name: light
    for light in (
        Light("baked"),
        Light("DL5000", relit=True, panels=0.9, around=0.12),
        Light(
            "DL300",
            relit=True,
            panels=0.9 * NIGHT,
            around=0.12 * NIGHT,
            outside_up=NIGHT_SKY,
            outside_down=NO_SKY,
        ),
        Light("CL", relit=True, lamp=2.4, around=0.012, outside_up=NO_SKY, outside_down=NO_SKY),
    )
}


def get_light(name: str) -> Light:
    """Return the light called `name`.

    Raises:
        UnknownNameError: no such light; the message lists the valid names.
    """
    check_name("light", name, LIGHTS)
    return LIGHTS[name]
