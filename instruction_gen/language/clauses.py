"""Cut a text into clauses, each with at most one verb that matters."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from .claims import Claim
from .lexicon import noun_kind
from .phrases import half_more, read_distance, read_side
from .tables import closed
from .tokens import Token
from .words import (
    BENDS,
    DETERMINERS,
    JOINTS,
    ORDINALS,
    PARTS,
    PREP_OF,
    PRONOUNS,
    SHARP,
    SLIGHT,
    VERB_OF,
    is_known,
)  # fmt: skip

MARKS = ("GO_IN", "GO_OUT", "GO_THROUGH")
_BREAKS = frozenset(",:—–-()+&")
_ENDS = frozenset(".!?;")
# A second verb of these begins a clause of its own: `go forward turn left`.
_OWN = frozenset("turn stop leave enter pass".split())
# Where a thing may be put down, and where a room may be left as well.
_PUT, _PUT_OR_OUT = closed("put where"), closed("put where, or out")
_PUTS, _CARRIES, _COLLECTS = closed("puts down"), closed("carries"), closed("collects")
_AFTER_LOAD = _PUT_OR_OUT | PREP_OF.keys() | JOINTS | _BREAKS | _ENDS
_NO_LOAD = closed("no load")
_CARRIED, _MOST_CARRIED = closed("carried"), 3  # words of what is carried
_AUXILIARY = closed("auxiliary")
_NOT_VERB_AFTER = closed("no verb after")
_ALSO_NOUNS = closed("noun, too")
_GOES = closed("way goes")
_OPENS = closed("opens")

_PART_WORDS = closed("before a part")


@dataclass
class Clause:
    """Tokens up to the next joint, and what has been read of them.

    Attributes:
        joint: the word or mark before it; "" at the beginning of a sentence.
        sentence: its number.
        until: it tells how far the clause before goes: `until you reach the sofa`.
        before: `before you reach the sofa`.
        verb: the kind of its verb; inherited in a list.
        prep: its last preposition.
        negated: it says what not to do.
        straight: it says `straight`.
        way: `up` or `down`, where it says so.
        place: where on stairs it is, see `claims.PLACES`.
        used: indices of the tokens that its claims cover.
        faults: what is wrong with its words.
    """

    tokens: list[Token]
    joint: str = ""
    sentence: int = 0
    until: bool = False
    before: bool = False
    verb: str = ""
    prep: str = ""
    negated: bool = False
    straight: bool = False
    way: str = ""
    place: str = ""
    claims: list[Claim] = field(default_factory=list)
    used: set[int] = field(default_factory=set)
    faults: list[str] = field(default_factory=list)

    @property
    def has_verb(self) -> bool:
        """Whether it has a verb of its own."""
        return any(verb_at(self.tokens, k) for k in range(len(self.tokens)))

    @property
    def last(self) -> Claim | None:
        """The last of its claims."""
        return self.claims[-1] if self.claims else None

    @property
    def is_straight(self) -> bool:
        """Whether the way that it tells has no turn."""
        across = any(token.text == "across" for token in self.tokens)
        turns = any(claim.kind == "turn" for claim in self.claims)
        return (across or self.straight) and not turns

    @property
    def lists_first(self) -> bool:
        """Whether it says `first` of what comes first, not the first of several."""
        words = ["", *(token.text for token in self.tokens), "."]
        k = words.index("first") if "first" in words else 0
        what = words[k + 1] in DETERMINERS or words[k + 1] == "see"
        return k > 0 and words[k - 1] not in DETERMINERS and what

    def says(self, *words: str) -> bool:
        """Return whether any of some words is in it."""
        return any(token.text in words for token in self.tokens)


def clauses_of(tokens: Sequence[Token]) -> list[Clause]:
    """Return the clauses of a text; some may be empty."""
    tokens = _without_load(tokens)
    result = [Clause([])]
    sentence = 0
    for k, token in enumerate(tokens):
        word = token.text
        if word in ("STRAIGHT", "straight"):
            result[-1].straight = True
        elif word in _ENDS:
            sentence += 1
            result.append(Clause([], sentence=sentence))
        elif half_more(tokens, k):
            result[-1].tokens.append(token)
        elif word in _BREAKS or word in JOINTS:
            if result[-1].tokens or word in JOINTS:
                result.append(Clause([], word, sentence))
        elif word == "without" and _begins(tokens, k + 1):
            result.append(Clause([token], "", sentence))
        elif word == "UNTIL" or (word in ("before", "after") and _begins(tokens, k + 1)):
            result.append(Clause([], "", sentence, until=True, before=word == "before"))
        else:
            own = word == "TURN_AROUND" or verb_at(tokens, k) in _OWN
            if own and result[-1].has_verb and not (k and tokens[k - 1].text in _AUXILIARY):
                result.append(Clause([], sentence=sentence))
            result[-1].tokens.append(token)
    return result


def _without_load(tokens: Sequence[Token]) -> list[Token]:
    """Return the tokens with `it` for what is carried or put down, which is nowhere on the way."""
    result = list(tokens)
    head = [t.text for t in tokens[: next((k for k, t in enumerate(tokens) if t.text == ":"), 0)]]
    titled = head.index("for") if "for" in head[1 : _MOST_CARRIED + 1] else 0
    if titled and not any(verb_at(tokens, k) or head[k] in _ENDS for k in range(titled)):
        # "Two flower pots for the bedroom: …"
        result[:titled] = [replace(tokens[0], text="it", stop=tokens[titled - 1].stop)]
    for k in range(len(result) - 1, -1, -1):
        word, end = result[k].text, _load_end(result, k)
        load = [replace(result[k + 1], text="it", stop=result[end - 1].stop)] if end > k + 1 else []
        loaded = [*result[: k + 1], *load, *result[max(end, k + 1) :]]
        goes_on = any(verb_at(loaded, n) not in ("", "see") for n in range(k + 2, len(loaded)))
        after = loaded[k + 2].text if load and k + 2 < len(loaded) else ""
        if word in _COLLECTS and k == 0 and "from" in (after, *[t.text for t in result[1:2]]):
            # "Collect the parcel from the office. … Drop it by the sofa."
            rest = [t for t in loaded[k + 1 :] if t not in load]
            result = [replace(result[0], text="start"), *rest] if goes_on else result
        elif word in _CARRIES and after in _CARRIED:
            result = loaded
        elif _puts_down(loaded, k) and not (load and word == "leave" and goes_on):
            result = [*loaded[:k], replace(loaded[k], text="deliver"), *loaded[k + 1 :]]
    return result


def _load_end(tokens: Sequence[Token], k: int) -> int:
    """Return where what the verb at token `k` carries ends, `k` where it is no such thing."""
    end = k + 2
    if tokens[k].text not in _PUTS | _CARRIES | _COLLECTS or len(tokens) < end:
        return k
    while end < len(tokens) and tokens[end].text not in _AFTER_LOAD:
        end += 1
    words = [token.text for token in tokens[k + 2 : end]]
    known = any(noun_kind(word) in ("room", "door", "storey") for word in (*words, tokens[k].text))
    if tokens[k].text == "take":  # no way that is taken: "take the second left to the sofa"
        known = known or not words or words[-1] in _NO_LOAD
        known = known or (is_known(words[-1]) and noun_kind(words[-1]) != "thing")
        known = known or not {"left", "right"}.isdisjoint(words)
    load = 0 < len(words) <= _MOST_CARRIED and not known and words[-1] not in ("stairs", "steps")
    return end if load and tokens[k + 1].text in DETERMINERS | {"my"} else k


def _puts_down(tokens: Sequence[Token], k: int) -> bool:
    """Return whether token `k` begins `leave it beside the sink`, where `it` is no room."""
    if VERB_OF.get(tokens[k].text) != "leave" and tokens[k].text not in _PUTS:
        return False
    words = [token.text for token in tokens[k:]] + [".", "."]
    if words[1] not in ("it", "them"):
        return False
    if words[2] not in _PUT_OR_OUT:
        return words[2] in _PUT or read_distance(tokens, k + 2) is not None
    side = read_side(tokens, k + 2)
    end = next(n for n, word in enumerate(words) if word in _ENDS | _BREAKS | JOINTS)
    if (words[2] == "behind" and end == 3) or (side and side[2] == k + end):
        return False  # "leave it behind", "leave it on the left"
    # "Leave it at the far door. Turn left …"
    goes_on = any(verb_at(tokens, n) not in ("", "see") for n in range(k + end, len(tokens)))
    return not (goes_on and any(noun_kind(word) == "door" for word in words[3:end]))


def _begins(tokens: Sequence[Token], k: int) -> bool:
    """Return whether a clause with a verb of its own begins: `before you reach the sofa`."""
    if k < len(tokens) and tokens[k].text in ("you", "it"):
        k += 1
    goes = k < len(tokens) and (tokens[k].text in MARKS or verb_at(tokens, k))
    return bool(goes) and tokens[k].text not in _ENDS


def verb_at(tokens: Sequence[Token], k: int) -> str:
    """Return the kind of verb at token `k`, "" where the word is none there."""
    word = tokens[k].text
    if word.isupper():
        return {"TURN_AROUND": "turn", "TOWARD": "toward"}.get(word, "")
    kind = VERB_OF.get(word, "")
    before = tokens[k - 1].text if k else ""
    after = tokens[k + 1].text if k + 1 < len(tokens) else ""
    if not (kind or before[:1].isalpha() or is_known(word)) and after in DETERMINERS | PRONOUNS:
        return "stop"  # "defrost the fridge", "put it down": what is to be done is done there
    count = before in ORDINALS and k > 1 and tokens[k - 2].text in DETERMINERS  # "the first turn"
    noun = (before in DETERMINERS and before not in ("that", "this", "both", "all")) or any(
        before in table for table in (SLIGHT, SHARP, _NOT_VERB_AFTER)
    )
    noun = noun or count
    if not kind or (noun and kind != "see" and word not in ("leads", "opens")):
        return ""
    if (word in PARTS and after == "of") or (
        word in _ALSO_NOUNS and (not after or after in PREP_OF)
    ):
        return ""
    return "go" if word in _GOES else "see" if word in _OPENS else kind


def part_end(tokens: Sequence[Token], k: int) -> int:
    """Return where a part ends that stands for what follows: `the end of`; `k` where none does."""
    j = k
    while j < len(tokens) and (tokens[j].text in DETERMINERS or tokens[j].text in _PART_WORDS):
        j += 1
    whole = j + 1 < len(tokens) and tokens[j].text in PARTS and tokens[j + 1].text == "of"
    return j + 2 if whole and tokens[k].text != "PLACE_OF" else k


def degree_of(tokens: Sequence[Token]) -> str:
    """Return `slight` or `sharp`, if any of the words says so."""
    words = {t.text for t in tokens}
    if words & SHARP:
        return "sharp"
    return "slight" if words & SLIGHT or words & BENDS else ""
