"""Words of indoor routes, as plain tables.

A label of a scan reaches a text only through these tables: a label with a word that is in none of
them names no landmark. So labels stay data, whatever they say.
"""

from functools import lru_cache

from .tables import closed, kind_of_word, rows_of, table_text

DOORS = closed("door")
COLOURS = kind_of_word("colours")
# Colours that people confuse.
COLOUR_NEIGHBOURS = rows_of("neighbours")
# Colours that things have, whatever a picture or a label says of them.
INNATE_COLOURS = {"plant": "green", "tree": "green"}
MATERIALS = kind_of_word("materials")
# Adjectives that nothing in a scene can refute.
ADJECTIVES = closed("adjective")
# These have no singular.
_PLURALS = closed("plural only")


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
# What people call storeys: `second floor` = `second level`.
_FLOORS = ("floor", "level", "storey", "story")
STOREYS = _table("storeys") | {
    f"{nth} floor": (frozenset(f"{nth} {floor}" for floor in _FLOORS), frozenset())
    for nth in rows_of("closed")["ordinals"][:10]
}


_ENDS = (("ies", 3, "y"), ("sses", 2, ""), ("xes", 2, ""), ("ches", 2, ""), ("shelves", 3, "f"))


@lru_cache(maxsize=4096)
def singular(word: str) -> str:
    """Return the singular: `chairs` → `chair`; a word that only looks like a plural stays."""
    for end, cut, add in _ENDS:
        if word.endswith(end) and word not in _PLURALS:
            return word[:-cut] + add
    if word.endswith("s") and not word.endswith(("ss", "us", "is")) and word not in _PLURALS:
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
STOREY_PHRASES = _phrases(STOREYS)


def noun_kind(word: str) -> str:
    """Return `thing`, `room`, `door` or `storey` for a noun, "" for other words."""
    forms = {word, singular(word)}
    if word in STOREY_PHRASES:
        return "storey"
    if forms & DOORS:
        return "door"
    if forms & ROOM_PHRASES.keys():
        return "room"
    return "thing" if forms & OBJECT_PHRASES.keys() else ""
