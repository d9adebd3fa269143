"""Words of indoor routes, as plain tables.

A label of a scan reaches a text only through these tables: a label with a word that is in none of
them names no landmark. So labels stay data, whatever they say.
"""

from functools import lru_cache

from .tables import closed, table_text

DOORS = closed("door")
_COLOURS = """black white grey=gray,silver red=maroon orange yellow=golden green=teal,olive
    blue=navy,turquoise purple=violet pink brown beige=cream,tan"""
COLOURS = {
    word: name
    for name, _, more in (entry.partition("=") for entry in _COLOURS.split())
    for word in (name, *more.split(",")) if word
}  # fmt: skip
# Colours that people confuse.
_NEIGHBOURS = """black=grey white=grey,beige grey=white,black,beige,blue,green red=orange,pink,brown
    orange=red,brown,yellow,beige yellow=orange,beige,green green=yellow,blue,grey
    blue=purple,green,grey purple=blue,pink pink=red,purple,beige brown=orange,beige,red,black
    beige=brown,white,yellow,grey,orange"""
COLOUR_NEIGHBOURS = {
    name: set(near.split(","))
    for name, _, near in (entry.partition("=") for entry in _NEIGHBOURS.split())
}
# Colours that things have, whatever a picture or a label says of them.
INNATE_COLOURS = {"plant": "green", "tree": "green"}
MATERIALS = {
    "wooden": "wooden", "wood": "wooden", "metal": "metal", "steel": "metal", "leather": "leather",
    "glass": "glass", "marble": "marble", "stone": "stone", "plastic": "plastic",
    "fabric": "fabric", "brick": "brick",
}  # fmt: skip
# Adjectives that nothing in a scene can refute.
ADJECTIVES = closed("adjective")
_IRREGULAR = {
    "shelves": "shelf", "bookshelves": "bookshelf", "benches": "bench", "couches": "couch",
    "dishes": "dishes", "boxes": "box", "steps": "steps", "stairs": "stairs",
}  # fmt: skip


def _table(name: str) -> dict[str, tuple[frozenset[str], frozenset[str]]]:
    """Read lines `canonical noun = synonyms < kinds it may also be called`.

    A comma at the end of a line goes on in the next.
    """
    result = {}
    for line in table_text(name).strip().replace(",\n", ",").splitlines():
        name, _, rest = line.partition("=")
        same, _, kinds = rest.partition("<")
        words = frozenset(w.strip() for w in same.split(",") if w.strip()) | {name}
        result[name] = (words, frozenset(w.strip() for w in kinds.split(",") if w.strip()))
    return result


OBJECTS = _table("objects")
ROOMS = _table("rooms")


@lru_cache(maxsize=4096)
def singular(word: str) -> str:
    """Return the singular: `chairs` → `chair`; a word that only looks like a plural stays."""
    if word in _IRREGULAR:
        return _IRREGULAR[word]
    for end, cut, add in (("ies", 3, "y"), ("sses", 2, ""), ("xes", 2, ""), ("ches", 2, "")):
        if word.endswith(end):
            return word[:-cut] + add
    if word.endswith("s") and not word.endswith(("ss", "us", "is")):
        return word[:-1]
    return word


def _phrases(table: dict[str, tuple[frozenset[str], frozenset[str]]]) -> dict[str, frozenset[str]]:
    found: dict[str, set[str]] = {}
    for name, (same, kinds) in table.items():
        for phrase in same | kinds:
            found.setdefault(phrase, set()).add(name)
    return {phrase: frozenset(names) for phrase, names in found.items()}


# Phrase → the canonical nouns or rooms that may be called so.
OBJECT_PHRASES = _phrases(OBJECTS)
ROOM_PHRASES = _phrases(ROOMS)


def noun_kind(word: str) -> str:
    """Return `thing`, `room` or `door` for a noun, "" for other words."""
    forms = {word, singular(word)}
    if forms & DOORS:
        return "door"
    if forms & ROOM_PHRASES.keys():
        return "room"
    return "thing" if forms & OBJECT_PHRASES.keys() else ""
