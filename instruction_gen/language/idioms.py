"""Replace idioms, whose meaning is not that of their words, by plainer words.

The grammar reads word by word; `make a turn to the left` and `come to rest` are replaced before.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, lru_cache

from .tokens import Token

# Words of a pattern: alternatives with |, optional with ?. {k} is the word that pattern word k met.
_IDIOMS = (
    ("make|take|do a|another|your slight|sharp? turn to|toward|towards", "{2} turn to"),
    ("turn your body|yourself", "turn"),
    ("toward|towards the|your left|right", "to {1} {2}"),
    ("off|over to|on the|your left|right|left-hand|right-hand", "{1} {2} {3}"),
    ("stop|stopping|halt|pause walking|moving|going", "{0}"),
    ("come|comes|coming to rest", "stop"),
    ("come|comes|coming to a complete|full|final? stop|halt|pause|standstill", "stop"),
    ("bring yourself to a stop|halt", "stop"),
    ("once|when|after you have|are done|finished with? that|this|so", "then"),
    ("after|having doing|done that|this|so", "then"),
    ("make|take|do a u-turn to? the|your? left|right?", "turn around"),
    ("after which", "then"),
    ("out by|at", "out through"),
    ("in at the|a|that|this", "in through {2}"),
    ("left|right through it|that|this", "{0} through it"),
    ("through it|that|this ,|.|;|and|then", "through that doorway {2}"),
    ("left|right of straight|dead? ahead", ""),
    ("left|right a bit|little|touch|tad", "slightly {0}"),
    ("a touch|tad|fraction", "slightly"),
    ("prior to", "before"),
    ("in the direction of", "toward"),
    ("at|to|on the side of", "beside"),
    ("at the front of", "in front of"),
    ("adjacent to?", "next to"),
    ("outside of", "outside"),
    ("circle|circling|round|rounding|circumvent the|it|this|that", "go around {1}"),
    ("a|one step|moment before|after|past", "{2}"),
    ("make|take|do|turn? two rights", "turn right then turn right"),
    ("make|take|do|turn? two lefts", "turn left then turn left"),
    ("make|take|do|turn? two left|right turns", "turn {2} then turn {2}"),
    ("left|right twice", "{0} then turn {0}"),
    ("which|that you will? keep|have|leave|pass on|to your|the left|right", "on your {6}"),
    ("ignoring|skipping|disregarding|disregard", "ignore"),
    ("on|to the|your other|opposite|far side of", "past"),
    ("with the? your? back to|toward|towards", "away from"),
    ("so that", "with"),
    ("that|which stands|stand", "that is"),
    ("you are there", "stop there"),
    ("at|by which point", "then"),
    ("hug|hugging the left|right wall?", "keep {2}"),
    ("you are|will going to", "you will"),
    ("is|are going to", "will"),
    ("you will have", "you will see"),
    ("is|are then|now|always", "{0}"),
    ("at once", "immediately"),
    (
        "take|through|enter|by|not|but|then the left|right|left-hand|right-hand one",
        "{0} the {2} doorway",
    ),
    ("take|through|enter|by|not|but|then the next|first|second|other one", "{0} the {2} doorway"),
    ("take|through|enter|by|not|but|then the|that|this one", "{0} {1} doorway"),
    ("take the next|first|second|third|other ,|.|and|;", "{0} the {2} doorway {3}"),
    ("at|to your? one|two|three|four|five o'clock", "on your right"),
    ("at|to your? seven|eight|nine|ten|eleven o'clock", "on your left"),
    ("at|to your? twelve o'clock", "ahead of you"),
    ("at|to your? six o'clock", "behind you"),
    ("at your? back left|right?", "behind you"),
    ("it is left|right out|then|at|into|through|again|,", "turn {2} {3}"),
    ("right to the back|end|edge|far|other", "to the {3}"),
    ("that is it|all", "stop there"),
    ("that is us|me ,|.|;", "stop there {3}"),
    ("hold it ,|.|;|here|there", "stop there {2}"),
    ("that is where you stop", "stop there"),
    ("that|this|there is the|your goal|stop|destination|target|finish|spot", "stop there"),
)
_STAYING = frozenset("stay remain".split())
_STOPPING = frozenset("stop wait halt pause stopping waiting".split())
_BESIDE = frozenset("beside next by at near in behind before there here".split())
_NO_PLACE = frozenset(
    """left right straight to on along going walking moving until clear out the your course
    slightly away""".split()
)


def plainer(tokens: Sequence[Token]) -> list[Token]:
    """Return the tokens of a text with idioms replaced; each keeps its place in the text."""
    result: list[Token] = []
    k = 0
    while k < len(tokens):
        for pattern, instead in _beginning_with(tokens[k].text):
            met = _met(pattern, tokens, k)
            if met is None:
                continue
            words, count = met
            said = [words[int(w[1:-1])] if w.startswith("{") else w for w in instead]
            span = Token("", tokens[k].start, tokens[k + count - 1].stop)
            result += [replace(span, text=word) for word in said if word]
            k += count
            break
        else:
            result.append(tokens[k])
            k += 1
    return _stops(_openers(result))


def _openers(tokens: list[Token]) -> list[Token]:
    """Return the tokens with `next` after a comma or full stop as `then`: `…, next stop here`."""
    result = list(tokens)
    for k, token in enumerate(tokens):
        opens = k == 0 or not tokens[k - 1].is_word
        if token.text == "next" and opens and tokens[k + 1 : k + 2] and tokens[k + 1].text != "to":
            result[k] = replace(token, text="then")
    return result


_Pattern = tuple[tuple[frozenset[str], bool], ...]


@lru_cache(maxsize=4096)
def _beginning_with(word: str) -> tuple[tuple[_Pattern, tuple[str, ...]], ...]:
    """Return the idioms that may begin with a word, in order."""
    return tuple(one for one in _table() if _may_begin(one[0], word))


def _may_begin(pattern: _Pattern, word: str) -> bool:
    for options, optional in pattern:
        if word in options or not optional:
            return word in options
    return False


@cache
def _table() -> tuple[tuple[_Pattern, tuple[str, ...]], ...]:
    def word(part: str) -> tuple[frozenset[str], bool]:
        return frozenset(part.rstrip("?").split("|")), part.endswith("?")

    return tuple((tuple(map(word, p.split())), tuple(i.split())) for p, i in _IDIOMS)


def _met(pattern: _Pattern, tokens: Sequence[Token], k: int) -> tuple[list[str], int] | None:
    """Return the words that a pattern matches at token `k` ("" if omitted), and how many tokens."""
    words: list[str] = []
    at = k
    for options, optional in pattern:
        if at < len(tokens) and tokens[at].text in options:
            words.append(tokens[at].text)
            at += 1
        elif optional:
            words.append("")
        else:
            return None
    return words, at - k


def _stops(tokens: list[Token]) -> list[Token]:
    """Return the tokens with a final `Stay by the bed.` or `end up next to it.` as a stop."""
    last = max((k for k, t in enumerate(tokens[:-1]) if t.text in ".;!"), default=-1)
    result = list(tokens)
    for k in range(len(tokens) - 1, last, -1):
        if tokens[k].text in _STOPPING:
            break
        following = [t.text for t in tokens[k + 1 : k + 3]]
        ends = tokens[k].text in ("end", "finish") and following[:1] == ["up"]
        if following[:1] == ["right"] and following[-1] in _BESIDE:
            following = following[1:]  # "stay right beside the bed"
        before = tokens[k - 1].text if k else ""
        arrived = before == "you" and tokens[k].text in ("should", "will") and following[0] == "be"
        stays = arrived or (
            tokens[k].text in _STAYING and following and following[0] not in _NO_PLACE
        )
        if ends or stays:
            result[k] = replace(tokens[k], text="stop")
            if ends:
                del result[k + 1]
            break
    return result
