"""Find the object that a USD prim belongs to, and its category."""

# usd-core builds its modules at run time and ships no stubs, so no attribute of them is known.
# pyright: reportAttributeAccessIssue=false

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
    chain = []
    at = prim
    while at and not at.IsPseudoRoot():
        chain.append(at)
        at = at.GetParent()
    for one in chain:
        word = written_label(one)
        if word is not None:
            return (str(one.GetPath()), word) if word else ("", "")
    for one in chain:
        word = category_of_name(one.GetName())
        if word and _is_model(one):
            return str(one.GetPath()), word
    for k, one in enumerate(chain):
        word = category_of_name(one.GetName())
        # The outermost prim is the scene, whatever it is called.
        if not word or word in _GROUPS or (k == len(chain) - 1 and k > 0):
            continue
        below = chain[k - 1] if k else None
        thing = one if below is None or below.IsA(UsdGeom.Gprim) else below
        return str(thing.GetPath()), word
    return "", ""


def _is_model(prim: Usd.Prim) -> bool:
    kind = Usd.ModelAPI(prim).GetKind()
    return bool(kind) and Kind.Registry.IsA(kind, Kind.Tokens.component)


def written_label(prim: Usd.Prim) -> str | None:
    """Return the class in the prim's own semantic attributes; None if it has none.

    Both ways of writing it are known: `semantics:labels:<taxonomy>` (UsdSemantics), of which the
    taxonomy `class` is preferred, and the older `semantic:<instance>:params:semanticData`.
    """
    found: dict[str, str] = {}
    for name in prim.GetPropertyNames():
        if name.startswith(_NEW_SEMANTICS):
            words = prim.GetAttribute(name).Get(Usd.TimeCode.EarliestTime())
            if words:
                found[name[len(_NEW_SEMANTICS) :]] = str(words[0])
        elif name.startswith(_OLD_SEMANTICS) and name.endswith(_DATA):
            kind = prim.GetAttribute(name.removesuffix(_DATA) + _TYPE).Get()
            word = prim.GetAttribute(name).Get()
            if word and (kind or "class") == "class":
                found.setdefault("class", str(word))
    if not found:
        return None
    word = found.get("class") or found[sorted(found)[0]]
    return category_of_name(word) or word.lower()
