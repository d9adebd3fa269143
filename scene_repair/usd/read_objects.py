"""Find the object that a USD prim belongs to, and its category."""

from pxr import Kind, Usd, UsdGeom

from ..labels.categories import category_of_name

# Prims that only group: what hangs below them are the things.
_GROUPS = frozenset(
    {"meshes", "furnitures", "furniture", "objects", "assets", "instances", "base", "animation",
     "base animation", "environment", "visual", "geom", "geometry", "component", "components",
     "structure", "prototypes", "render", "others", "house", "building", "room", "rooms"}
)  # fmt: skip
_OLD_SEMANTICS, _DATA, _TYPE = "semantic:", ":params:semanticData", ":params:semanticType"
_NEW_SEMANTICS = "semantics:labels:"


def object_of(prim: Usd.Prim) -> tuple[str, str]:
    """Return name (a prim path) and category of the object of `prim`; both empty if unknown.

    Written labels come first, the nearest ancestor's first. Then names count: the nearest model's
    (a prim of kind `component`), or else the nearest one with a meaningful name. Where that is a
    folder of things (`bed/model_1a2b/…`), the thing is the prim below it.
    """
    chain = [prim]
    while (parent := chain[-1].GetParent()) and not parent.IsPseudoRoot():
        chain.append(parent)
    for at in chain:
        word = written_label(at)
        if word is not None:
            return (str(at.GetPath()), word) if word else ("", "")
    for at in chain:
        word = category_of_name(at.GetName())
        kind = Usd.ModelAPI(at).GetKind()
        if word and kind and Kind.Registry.IsA(kind, Kind.Tokens.component):
            return str(at.GetPath()), word
    for k, at in enumerate(chain):
        word = category_of_name(at.GetName())
        # The outermost prim is the scene, whatever it is called.
        if not word or word in _GROUPS or (k == len(chain) - 1 and k > 0):
            continue
        below = chain[k - 1] if k else None
        thing = at if below is None or below.IsA(UsdGeom.Gprim) else below
        return str(thing.GetPath()), word
    return "", ""


def written_label(prim: Usd.Prim) -> str | None:
    """Return the class in the prim's own semantic attributes; None if it has none.

    Both ways of writing it are known: `semantics:labels:<taxonomy>` (UsdSemantics), of which the
    taxonomy `class` is preferred, and the older `semantic:<instance>:params:semanticData`.
    """
    labels: dict[str, str] = {}
    for name in prim.GetPropertyNames():
        if name.startswith(_NEW_SEMANTICS):
            words = prim.GetAttribute(name).Get(Usd.TimeCode.EarliestTime())
            if words:
                labels[name[len(_NEW_SEMANTICS) :]] = str(words[0])
        elif name.startswith(_OLD_SEMANTICS) and name.endswith(_DATA):
            kind = prim.GetAttribute(name.removesuffix(_DATA) + _TYPE).Get()
            word = prim.GetAttribute(name).Get()
            if word and (kind or "class") == "class":
                labels.setdefault("class", str(word))
    if not labels:
        return None
    word = labels.get("class") or labels[sorted(labels)[0]]
    return category_of_name(word) or word.lower()
