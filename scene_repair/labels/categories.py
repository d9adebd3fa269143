"""What things are called: categories from node names and from label files."""

from __future__ import annotations

import re

# Words that tell variants of one thing apart, or where it is used, but not what it is.
_GENERIC = {
    "geometry", "mesh", "node", "object", "obj", "group", "default", "root", "scene", "world",
    "polysurface", "shape", "primitive", "untitled", "none", "material", "model", "instance",
    "component", "xform", "scope", "geom", "sm", "chunk", "part", "piece", "segment", "submesh",
    "texture", "atlas", "scan", "lod", "cube", "plane", "layer",
}  # fmt: skip
# Last words of what certainly is no floor. Any other word (`apartment`, `ground truth`) may be the
# name of a node that holds the floor too.
_THINGS = """
airconditioner appliance armchair bag ball banister banisters bar barrel basin basket bath
bathtub beam bed bench bicycle bidet bin blanket blind blinds board boiler bookcase books
bookshelf bottle bowl box bucket cabinet cabinets camera can candle cart carton ceiling chair
chairs chandelier chest chimney clock closet clothes coat column computer conditioner container
cooker couch counter countertop cradle crate crib cup cupboard curtain curtains cushion desk
dishwasher door doorframe drawer drawers dresser dryer dumbbell dumbbells equipment fan faucet
fence fireplace flower frame freezer fridge furniture globe guitar handle heater hood island
kettle keyboard knickknack ladder lamp laptop ledge light lighting lights lintel locker machine
magazine mantle mattress microwave mirror mixer monitor nightstand ornament ottoman oven paper
partition pedestal phone piano picture pictures pillar pillow pipe plant plants plate poster pot
pouf printer rack radiator rail railing rangehood refrigerator rod roof sconce screen sculpture
seat shade shelf shelves shelving shoe shoes showcase shower shutter shutters sideboard sign
sink sofa speaker speakers stair staircase stairs stand statue stool stove suitcase switch table
tables tablet tableware tank television toilet towel towels toy trash tray treadmill tree trim
tub tv utensils vase vent wall wallpaper walls wardrobe washbasin washer whiteboard window
windows windowsill
"""
THINGS = frozenset(_THINGS.split())
# Names of generated models carry digests: `model_856a914fb4f3_0`.
_HASH = re.compile(r"(?<![A-Za-z0-9])(?=[0-9a-fA-F]*[0-9])[0-9a-fA-F]{6,}(?![A-Za-z0-9])")
# Compounds that names run together or that a plain split would misread.
_ALIASES = {
    "tv": "tv",
    "tvcabinet": "tv cabinet",
    "nightstand": "nightstand",
    "night stand": "nightstand",
    "kitchen table": "kitchen table",
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
    "screen": "screen",
}


def category_of_name(name: str) -> str:
    """Category that a node's name tells, `KitchenTable_1` → `kitchen table`; empty if none.

    Splits camel case and separators, drops numbers and single-letter variants (`SofaC_1` → sofa).
    """
    base = _HASH.sub(" ", name)
    base = re.sub(r"\.(obj|fbx|dae|ply|stl|glb|gltf|usd[acz]?)\b", "", base, flags=re.IGNORECASE)
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", base)
    words = [w.lower() for w in re.split(r"[^A-Za-z]+", spaced) if w]
    words = [w for w in words if len(w) > 1 and w not in _GENERIC]
    text = " ".join(words)
    return _ALIASES.get(text, text)
