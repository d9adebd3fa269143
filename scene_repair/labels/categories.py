"""Categories of objects, from node names and label files."""

import re

from ...formats.scene.things import THINGS as THINGS

# Words for variants of a thing or where it is used, not for what it is.
_GENERIC = {
    "geometry", "mesh", "node", "object", "obj", "group", "default", "root", "scene", "world",
    "polysurface", "shape", "primitive", "untitled", "none", "material", "model", "instance",
    "component", "xform", "scope", "geom", "sm", "chunk", "part", "piece", "segment", "submesh",
    "texture", "atlas", "scan", "lod", "cube", "plane", "layer",
}  # fmt: skip
# Names of generated models carry digests: `model_856a914fb4f3_0`.
_HASH = re.compile(r"(?<![A-Za-z0-9])(?=[0-9a-fA-F]*[0-9])[0-9a-fA-F]{6,}(?![A-Za-z0-9])")
# Compounds that names run together or that a plain split would misread.
_ALIASES = {
    "tvcabinet": "tv cabinet",
    "night stand": "nightstand",
    "room window": "window",
    "room wall": "wall",
    "house wall": "wall",
    "folding door": "door",
    "portrait": "picture",
    "desk portrait": "picture",
    "light": "lamp",
    "trash": "trash can",
    "board": "shelf",
    "couch": "sofa",
    "wall face": "wall",
    "wall art": "picture",
    "invisible wall face": "wall",
    "window frame": "window",
    "door frame": "door",
    "global mesh": "",
    "elevator door": "elevator",
    "elevator portal": "elevator",
    "curtain closed": "curtain",
    "curtain open": "curtain",
    "curtain half open": "curtain",
    "nursesstation": "reception desk",
}


def category_of_name(name: str) -> str:
    """Return the category in a node's name, `KitchenTable_1` → `kitchen table`; empty if none.

    Splits camel case and separators, drops numbers and single-letter variants (`SofaC_1` → sofa).
    """
    base = _HASH.sub(" ", name)
    base = re.sub(r"\.(obj|fbx|dae|ply|stl|glb|gltf|usd[acz]?)\b", "", base, flags=re.IGNORECASE)
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", base)
    words = [w.lower() for w in re.split(r"[^A-Za-z]+", spaced) if w]
    words = [w for w in words if len(w) > 1 and w not in _GENERIC]
    text = " ".join(words)
    return _ALIASES.get(text, text)
