"""Reword true texts: the same route in other words, by a table of exchangeable phrases.

People say the same thing in many ways. A text that is true stays true under every exchange below,
so each refusal of a reworded text is a gap in the checker's grammar or words.
"""

import re

import numpy as np

# Pattern → what may be said instead. Patterns match lower-case text; a capital is put back.
_EXCHANGES: tuple[tuple[str, tuple[str, ...]], ...] = (
    (r"\bturn (left|right)\b", (
        r"take a \1", r"make a \1", r"hang a \1", r"go \1", r"turn to the \1", r"turn to your \1",
        r"make a \1 turn", r"take a \1 turn", r"make a turn to the \1", r"head \1", r"swing \1",
        r"turn toward the \1", r"turn your body \1", r"you need to turn \1", r"turn \1 90 degrees",
        r"turn off to the \1",
    )),
    (r"\bbear (left|right)\b", (
        r"veer \1", r"veer off to the \1", r"keep \1", r"angle \1", r"bear to the \1",
        r"curve to the \1", r"drift \1", r"move slightly \1", r"slant \1",
    )),
    (r"\b(?:leave|exit) the (\w+(?: room)?)(?=[,.]| and\b| to\b)", (
        r"walk out of the \1", r"go out of the \1", r"step out of the \1", r"come out of the \1",
        r"head out of the \1", r"get out of the \1", r"walk out the door of the \1",
        r"make your way out of the \1", r"go through the \1 door", r"exit from the \1",
        r"move out of the \1", r"leave this \1",
    )),
    (r"\b(?:walk|go) past\b", (
        "pass", "walk by", "go by", "continue past", "keep going past", "proceed past",
        "move past", "pass by", "stroll past", "head past", "carry on past", "go on past",
        "walk straight past", "keep walking past", "you will pass", "you'll go past",
        "travel past", "go all the way past",
    )),
    (r"\b(?:go|walk) into the\b", (
        "enter the", "step into the", "head into the", "move into the", "continue into the",
        "proceed into the", "go in the", "walk in to the", "make your way into the",
        "go inside the", "go through to the", "cross into the",
    )),
    (r"\benter the\b", ("go into the", "walk into the", "step inside the", "come into the")),
    (r"\b(?:walk|go|head) (?:straight )?down the (hallway|hall|corridor)\b", (
        r"follow the \1", r"walk along the \1", r"continue down the \1", r"go along the \1",
        r"proceed down the \1", r"walk through the \1", r"keep going down the \1",
        r"make your way down the \1", r"go straight along the \1", r"move down the \1",
        r"walk the \1", r"travel down the \1",
    )),
    (r"\bstop (?=next|beside|by|in|at|near|just|between|with|when|once|before)", (
        "wait ", "halt ", "come to a stop ", "pause ", "come to a halt ", "and you should stop ",
        "then come to rest ", "stop and wait ", "stand ", "end up ", "please stop ", "stay ",
        "you're done ", "stop walking ", "stop right ", "stop once you're ",
    )),
    (r"\bnext to\b", (
        "beside", "by", "right beside", "close to", "near", "alongside", "right next to",
        "adjacent to", "at the side of", "to the side of", "just by",
    )),
    (r"\bin front of\b", (
        "right in front of", "before", "just in front of", "facing", "directly in front of",
        "just before", "at the front of", "right before",
    )),
    (r"\bon your (left|right)\b", (
        r"on the \1", r"to your \1", r"to the \1", r"on your \1 side", r"on your \1-hand side",
        r"on the \1 side", r"at your \1", r"on the \1-hand side", r"to your \1-hand side",
        r"off to your \1", r"over on your \1",
    )),
    (r"\bhallway\b", ("hall", "corridor", "passageway", "hall way")),
    (r"\btv\b|\btelevision\b", ("television", "tv set", "flat screen", "telly", "big tv")),
    (r"\bsofa\b", ("couch", "settee", "big sofa", "sofa there", "long couch")),
    (r"\bwashbasin\b", ("sink", "wash basin", "bathroom sink", "basin")),
    (r"\bwardrobe\b", ("closet", "armoire", "tall wardrobe", "wardrobe closet")),
    (r"\bbookshelf\b", ("bookcase", "book shelf", "shelf of books", "shelf with books")),
    (r"\bdining table\b", ("table", "dinner table", "big table", "dining room table")),
    (r"\brefrigerator\b", ("fridge", "refrigerator there", "fridge freezer")),
    (r"\bkitchen counter\b", ("counter", "countertop", "worktop", "kitchen countertop")),
    (r"\bdresser\b", ("chest of drawers", "drawers")),
    (r"\bplant\b", ("potted plant", "house plant", "green plant", "pot plant", "houseplant")),
    (r"\bcoat rack\b", ("coat stand", "coat hanger", "clothes rack", "coat rack there")),
    (r"\bshoe cabinet\b", ("shoe cupboard", "cabinet for shoes", "shoe storage cabinet")),
    (r"\brug\b", ("carpet", "mat", "area rug", "rug on the floor")),
    (r"\bbathtub\b", ("tub", "bath", "bath tub")),
    (r"\bfloor lamp\b", ("lamp", "standing lamp", "tall lamp", "light")),
    (r"\bcoffee table\b", ("low table", "small table", "coffee table there")),
    (r"\bdoor\b", ("doorway", "open door", "door frame")),
    (r"\bbefore you reach the\b", (
        "before the", "before you get to the", "just short of the", "a step before the",
        "right before you get to the", "before reaching the", "prior to reaching the",
    )),
    (r"\bwhen you reach the\b", (
        "when you get to the", "once you reach the", "upon reaching the", "as you reach the",
        "as soon as you reach the", "when you arrive at the", "when you come to the",
        "after you reach the", "once you've reached the",
    )),
    (r", then ", (
        ". Then ", ", and then ", "; then ", ". After that, ", ", next ", ". Next, ", ", and ",
        ". From there, ", ". Once you've done that, ", ", after which ",
    )),
    (r"\bkeep going\b", (
        "continue", "keep walking", "carry on", "go on", "proceed", "keep moving", "walk on",
        "keep heading", "move on",
    )),
    (r"\bgo straight\b|\bwalk straight\b", (
        "walk straight ahead", "continue straight", "go forward", "head straight",
        "move straight ahead", "keep straight", "walk forwards", "go straight on",
    )),
    (r"\ball the way to\b", ("up to", "right up to", "until you reach", "as far as")),
)  # fmt: skip
_OPENINGS = (
    "Start by facing the way you are. ", "OK, ", "First, ", "To begin, ", "You want to ",
    "Alright, ", "From where you are, ", "From your starting point, ", "Now ",
)  # fmt: skip
_OPENED = 0.15


def reworded(text: str, rng: np.random.Generator, most: int = 4) -> str:
    """Return a text with up to `most` of its phrases exchanged."""
    order = rng.permutation(len(_EXCHANGES))
    done = 0
    for number in order:
        pattern, instead = _EXCHANGES[int(number)]
        matches = list(re.finditer(pattern, text, re.IGNORECASE))
        if not matches or done >= most:
            continue
        match = matches[int(rng.integers(len(matches)))]
        phrase = match.expand(instead[int(rng.integers(len(instead)))])
        if match[0][0].isupper():
            phrase = phrase[0].upper() + phrase[1:]
        text = text[: match.start()] + phrase + text[match.end() :]
        done += 1
    if rng.random() < _OPENED:
        text = _OPENINGS[int(rng.integers(len(_OPENINGS)))] + text[0].lower() + text[1:]
    return text
