"""A colour's name, where there is no doubt about it."""

import colorsys


def colour_name(rgb: tuple[int, int, int]) -> str:
    """Return the name of a mean sRGB colour (0–255), "" between names.

    Scans are lit warmly and unevenly: greys, whites and browns run into each other, so only
    clearly coloured and clearly dark things are named.
    """
    hue, saturation, value = colorsys.rgb_to_hsv(*(v / 255 for v in rgb))
    degrees = 360 * hue
    if value < 0.16:
        return "black"
    if saturation < 0.38 or value < 0.22:
        return ""
    for low, high, name in (
        (0, 12, "red"),
        (20, 36, "brown" if value < 0.55 else ""),
        (48, 62, "yellow" if value > 0.5 else ""),
        (85, 160, "green"),
        (200, 250, "blue"),
        (265, 300, "purple"),
        (348, 361, "red"),
    ):
        if low <= degrees < high:
            return name
    return ""
