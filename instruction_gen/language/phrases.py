"""Noun phrases, distances and sides in a row of tokens."""

from collections.abc import Sequence
from dataclasses import replace

from .claims import Claim
from .lexicon import (
    ADJECTIVES,
    COLOURS,
    MATERIALS,
    OBJECT_PHRASES,
    ROOM_PHRASES,
    noun_kind,
    singular,
)
from .tables import closed
from .tokens import Token
from .words import (
    DETERMINERS,
    NUMBERS,
    OPENINGS,
    ORDINALS,
    PREP_OF,
    UNITS_M,
    VAGUE_COUNTS,
    VERB_OF,
    number_of,
)

_SIDES = ("left", "right")
_VAGUE_M = 2.0


# A target that is named, as a claim that it is seen; the tokens that name it; the one after it.
Phrase = tuple[Claim, tuple[int, ...], int]


def read_phrase(tokens: Sequence[Token], k: int) -> Phrase | None:
    """Return the target that begins at token `k`, None where none does."""
    first = k
    side, ordinal, count, colour, material = "", 0, 0, "", ""
    used: list[int] = []
    while k < len(tokens):
        word = tokens[k].text
        if word in DETERMINERS and k == first:
            after = tokens[k + 1].text if k + 1 < len(tokens) else ""
            if word == "that" and after in VERB_OF:
                return None
        elif word in _SIDES and k > first - 1 and _leads_to_noun(tokens, k + 1):
            side = word
        elif word in ORDINALS and not _is_unit(tokens, k + 1):
            ordinal = ORDINALS[word]
        elif (number := number_of(word)) is not None and not noun_kind(word):
            count = int(number)
        elif word in COLOURS:
            colour = COLOURS[word]
        elif word in MATERIALS and _leads_to_noun(tokens, k + 1):
            material = MATERIALS[word]
        elif not (
            word in ADJECTIVES or (word in VAGUE_COUNTS and k > first) or (side and word in _HAND)
        ):
            break
        used.append(k)
        k += 1
    names: list[str] = []
    start = k
    while k < len(tokens) and noun_kind(tokens[k].text):
        bare = not names and start == first and not (k and tokens[k - 1].text in PREP_OF)
        # "The upstairs hallway", "the hall upstairs".
        storey = bool(names) and "storey" in (noun_kind(names[-1]), noun_kind(tokens[k].text))
        if (
            (tokens[k].text in _VERBLIKE and bare)
            or (tokens[k].text == "stands" and names)
            or storey
        ):
            break
        names.append(tokens[k].text)
        own = k + 1 < len(tokens) and tokens[k + 1].text == "'s"
        used += range(k, k + 1 + own)
        k += 1 + own
    seen = Claim("see", "", "", side, ordinal, count, colour, material)
    return _named(tokens, k, names, seen, tuple(used)) if names else None


# Nouns that are verbs where no determiner goes before them.
_VERBLIKE = closed("noun, or verb")


def _named(
    tokens: Sequence[Token], k: int, names: list[str], seen: Claim, used: tuple[int, ...]
) -> Phrase:
    head, before = names[-1], names[:-1]
    what = noun_kind(head)
    room = next((n for n in before if noun_kind(n) == "room"), "")
    name = head if head in OBJECT_PHRASES or head in ROOM_PHRASES else singular(head)
    if what == "thing":
        name = " ".join([*(n for n in before if noun_kind(n) == what), name])
    if what == "door":
        name = "opening" if singular(head) in OPENINGS else ""
    target = replace(seen, what=what, name=name, room=room)
    # "The door of the bedroom", "the table in the kitchen".
    after = k
    joined = ("of", "to", "from", "in") if what == "door" else ("of", "in")
    while after < len(tokens) and tokens[after].text in _LINKS and what == "door":
        after += 1
    if not room and after < len(tokens) and PREP_OF.get(tokens[after].text) in joined:
        owner, more, end = read_phrase(tokens, after + 1) or (Claim("see"), (), 0)
        if owner.what == "room" and what in ("thing", "door") and not owner.ordinal:
            return replace(target, room=owner.name), (*used, *range(k, after + 1), *more), end
        if owner.what == "thing" and tokens[after].text == "of" and what != "room":
            return target, (*used, after, *more), end  # "a chair of the table"
    return target, used, k


_LINKS = closed("door leads")
_HAND = ("hand", "side", "most")
_BEFORE_NOUNS = ADJECTIVES.union(COLOURS, MATERIALS, ORDINALS, _HAND)


def _leads_to_noun(tokens: Sequence[Token], k: int) -> bool:
    """Return whether a noun follows after adjectives only."""
    while k < len(tokens) and tokens[k].text in _BEFORE_NOUNS:
        k += 1
    word = tokens[k].text if k < len(tokens) else "."
    return bool(noun_kind(word)) or word in ("wall", "one")


def _is_unit(tokens: Sequence[Token], k: int) -> bool:
    return k < len(tokens) and tokens[k].text in UNITS_M


def read_distance(tokens: Sequence[Token], k: int) -> tuple[float, bool, int] | None:
    """Return a distance [m], whether it is vague, and the token after it."""
    total, seen, vague, fraction = 0.0, False, False, 1.0
    first = k
    while k < len(tokens):
        word = tokens[k].text
        if word in UNITS_M:
            unit = UNITS_M[word]
            if not seen and not (k > first and tokens[k - 1].text in _ONE_UNIT):
                if not (vague or word in ("steps", "metres", "meters", "paces")):
                    return None
                vague = True
            amount = (total if seen else 1.0) * fraction
            if vague and not seen:
                return _VAGUE_M, True, k + 1
            k += 1
            after = [t.text for t in tokens[k : k + 3]]
            if half := half_more(tokens, k):
                amount, k = amount + 0.5, k + half
            elif after[:2] == ["or", "two"]:
                return 1.5 * unit, True, k + 2
            return amount * unit, vague, k + 2 * (after[:2] == ["or", "so"])
        number = number_of(word)
        if word in ("half", "quarter", "halfway"):
            part = NUMBERS.get(word, 0.5)
            total, fraction = (total + part, fraction) if seen else (total, part)
        elif word in ("couple", "few", "several", "some"):
            vague = True
        elif number is not None:
            if word == "hundred" or word == "thousand":
                total = max(total, 1.0) * number
            elif seen and tokens[k - 1].text in ("or", "to", "-", "–"):
                total = 0.5 * (total + number)
            else:
                total += number
            seen = True
        elif word not in _IN_DISTANCE:
            return None
        k += 1
    return None


def half_more(tokens: Sequence[Token], k: int) -> int:
    """Return how many tokens at `k` are `and (a) half`, 0 where they are not."""
    words = [t.text for t in tokens[k : k + 3]]
    return 3 if words == ["and", "a", "half"] else 2 * (words[:2] == ["and", "half"])


_ONE_UNIT = closed("one unit")
_IN_DISTANCE = closed("in a distance")


def read_side(tokens: Sequence[Token], k: int) -> tuple[str, bool, int] | None:
    """Return a side, whether it is a place (`on your left`), and the token after it."""
    first = k
    placed = False
    while k < len(tokens) and (tokens[k].text in _TO_SIDE or (k > first and placed)):
        word = tokens[k].text
        if word in _SIDES:
            break
        if word not in _TO_SIDE:
            return None
        placed = placed or word in ("on", "to", "at", "in", "your", "toward", "towards")
        k += 1
        if k - first > 5:
            return None
    if k >= len(tokens) or tokens[k].text not in _SIDES:
        return _before_or_behind(tokens, first)
    side = tokens[k].text
    if _leads_to_noun(tokens, k + 1) and not _hand(tokens, k + 1):
        return None
    k += 1
    while k < len(tokens) and tokens[k].text in ("hand", "side", "of", "you"):
        if tokens[k].text == "of" and [t.text for t in tokens[k + 1 : k + 2]] != ["you"]:
            break
        k += 1
    return side, placed, k


_TO_SIDE = closed("to a side")


def _hand(tokens: Sequence[Token], k: int) -> bool:
    """Return whether `hand` or `side` at token k ends the phrase rather than leading to a noun."""
    while k < len(tokens) and tokens[k].text in ("hand", "side"):
        k += 1
    return k >= len(tokens) or not (noun_kind(tokens[k].text) or tokens[k].text in ("one", "wall"))


def _before_or_behind(tokens: Sequence[Token], k: int) -> tuple[str, bool, int] | None:
    two = [t.text for t in tokens[k : k + 2]]
    if two in (["before", "you"], ["before", "of"]):
        return "ahead", True, k + 2
    if two == ["behind", "you"]:
        sided = read_side(tokens, k + 2)
        return sided if sided and sided[1] else ("behind", True, k + 2)
    if two[:1] == ["ahead"] and (sided := read_side(tokens, k + 1)) is not None:
        return sided[0], True, sided[2]  # "ahead on the right"
    if two == ["ahead"] or (two[:1] == ["ahead"] and two[1] not in DETERMINERS):
        return "ahead", True, k + 1
    return None
