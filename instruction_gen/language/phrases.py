"""Reading noun phrases."""

from collections.abc import Sequence

from .clauses import Noun
from .function_words import VERB_OF
from .lexicon import (
    ADJECTIVES,
    COLOURS,
    DOORS,
    GENERIC,
    MATERIALS,
    NUMBERS,
    OBJECT_PHRASES,
    ORDINALS,
    PARTS,
    ROOM_PHRASES,
    singular,
)
from .tokens import Token

DETERMINERS = frozenset(
    "the a an your our this that these those its their some both all any each every".split()
)
_MAIN = frozenset("front main entrance entry apartment house".split())
_BARE = frozenset("it them there here".split())


def is_object(word: str) -> bool:
    """Return whether a word or phrase, also in the plural, names a kind of thing."""
    return word in OBJECT_PHRASES or _single(word) in OBJECT_PHRASES


def is_room(word: str) -> bool:
    """Return whether a word or phrase names a kind of room."""
    return word in ROOM_PHRASES or _single(word) in ROOM_PHRASES


def _single(phrase: str) -> str:
    words = phrase.split()
    return " ".join([*words[:-1], singular(words[-1])]) if words else ""


def read_noun(tokens: Sequence[Token], k: int) -> tuple[Noun, int] | None:
    """Return the noun phrase that begins at token `k`, and the token after it.

    None when none does.
    """
    start = k
    determined = number = ordinal = 0
    colour = material = side = ""
    only = False
    words: list[str] = []
    while k < len(tokens) and tokens[k].is_word:
        word = tokens[k].text
        after = tokens[k + 1].text if k + 1 < len(tokens) else ""
        if word in DETERMINERS and not words:
            determined = 1
        elif word in ("of",) and words == []:
            pass
        elif word in ORDINALS and not words and (_can_follow(after) or word[0].isdigit()):
            ordinal = ORDINALS[word]
        elif (word in NUMBERS or word.isdigit()) and not words:
            number = NUMBERS.get(word) or int(word) if word.isdigit() else NUMBERS[word]
        elif word == "pair" and after == "of":
            number, k = 2, k + 1
        elif word in ("left", "right") and _can_follow(after) and after not in ("of",):
            side = word
        elif word in ("left-hand", "right-hand", "lefthand", "righthand"):
            side = word[:-4].rstrip("-")
        elif word == "only" and determined:
            only = True
        elif word in COLOURS and (_can_follow(after) or is_object(after)):
            colour = COLOURS[word]
        elif word in MATERIALS and (_can_follow(after) or is_object(after)):
            material = MATERIALS[word]
        elif word in _MAIN and after == "door":
            # The door of the whole apartment leads nowhere on a route.
            return Noun(f"{word} door", "generic", "way", start=start, stop=k + 2), k + 2
        elif not words and word in PARTS and after == "of":
            words.append(word)
            k += 1
            break
        elif is_object(word) or is_room(word) or word in DOORS:
            words.append(word)
            k += 1
            # Two nouns in a row are one thing: "kitchen table", "bathroom door".
            joins = k < len(tokens) and _noun(tokens[k].text) and tokens[k].text not in VERB_OF
            if joins and tokens[k].text not in GENERIC:
                continue
            break
        elif word in GENERIC and not (word in ADJECTIVES and _can_follow(after)):
            lone = not (determined or number or ordinal or words)
            if lone and word not in _BARE and not _noun(word):
                return None
            words.append(word)
            k += 1
            break
        elif word in ADJECTIVES:
            pass
        elif determined and word.isalpha() and not words and word not in _STOPWORDS:
            words.append("?" + word)
            if not (after and after[0].isalpha() and after not in _STOPWORDS):
                k += 1
                break
        elif determined and words and words[-1].startswith("?") and word not in _STOPWORDS:
            words.append("?" + word)
        else:
            break
        k += 1
    if not words:
        return None
    text = " ".join(w.lstrip("?") for w in words)
    head, kind = _kind(words)
    plural = head != text and singular(text.split()[-1]) != text.split()[-1]
    noun = Noun(
        text, kind, head, plural, number, ordinal, colour, material, only, side,
        start=start, stop=k,
    )  # fmt: skip
    if kind == "door" and k + 1 < len(tokens) and tokens[k].text in ("of", "to"):
        inner = read_noun(tokens, k + 1)  # "the door of the bedroom", "the door to the hall"
        if inner is not None and inner[0].kind == "room":
            if words[-1] == "entrance":
                return _placed(inner[0], "entrance", start, inner[1], plural), inner[1]
            return noun, inner[1]
    if (head in PARTS or head in ("side", "end")) and k < len(tokens) and tokens[k].text == "of":
        inner = read_noun(tokens, k + 1)
        if inner is not None:
            thing, stop = inner
            part = f"{side} side" if side else head
            return _placed(thing, part, start, stop, plural), stop
    return noun, k


def _placed(thing: Noun, part: str, start: int, stop: int, plural: bool) -> Noun:
    return Noun(
        thing.text, thing.kind, thing.head, thing.plural or plural, thing.number, thing.ordinal,
        thing.colour, thing.material, thing.only, thing.side, part=part, start=start, stop=stop,
    )  # fmt: skip


def _noun(word: str) -> bool:
    return is_object(word) or is_room(word) or word in DOORS


def _can_follow(word: str) -> bool:
    """Return whether `word` can end or go on a noun phrase."""
    return bool(word) and (
        _noun(word)
        or (word in GENERIC and word not in ("left", "right", "it", "you", "them"))
        or word in ADJECTIVES
        or word in COLOURS
        or word in MATERIALS
        or word in NUMBERS
    )


def _kind(words: list[str]) -> tuple[str, str]:
    last = words[-1]
    if any(w.startswith("?") for w in words):
        known = [w for w in words if not w.startswith("?")]
        if known and known[-1] == last:
            # An unknown word before a known noun: an adjective that we do not know.
            words = known
        else:
            return " ".join(w.lstrip("?") for w in words), "unknown"
    phrase = " ".join(words)
    single = _single(phrase)
    if last in DOORS and (len(words) > 1 or last not in ROOM_PHRASES):
        return "door", "door"
    for candidate in (phrase, single, last, _single(last)):
        if candidate in OBJECT_PHRASES:
            return (single if len(words) > 1 else candidate), "object"
        if candidate in ROOM_PHRASES:
            return candidate, "room"
    return last, "generic"


_STOPWORDS = frozenset(
    """to into in on at of by past until through and then with before after from toward towards for
    near beside next behind beyond along across around between against over under off up down out
    is are was will be have has can should must that which where when while as so but or not you
    your it they them there here straight ahead left right turn walk go stop wait move continue
    enter exit leave pass head follow take make keep bear veer about roughly only just again
    directly immediately""".split()
)
