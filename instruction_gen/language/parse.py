"""A small grammar of route instructions.

    text    := clause { joint clause }
    joint   := "." | "," | ";" | "and" | "then" | "until" | "once" | "when" | "before" | "after" | …
    clause  := [verb] { direction | distance | [preposition] noun [place] | adverb }
    place   := ("on" | "to") ("your" | "the") side

Verbs, prepositions and sides come from tables; nouns from the lexicon. A noun that it does not
know is kept as `unknown`, because an invented thing is a lie.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from .clauses import Clause, Noun, Parse
from .distances import STEPS, read_distance
from .function_words import (
    BEND_WORDS,
    BY_YOU,
    FILLERS,
    JOINTS,
    KEEP,
    NOUNLIKE,
    OPENERS,
    PHRASES,
    PREPOSITIONS,
    RIGHT_ADVERB,
    SECOND,
    SEVERAL,
    SHARP,
    SLIGHT,
    THERE,
    TURN_PLACE,
    UNTIL,
    VERB_OF,
)
from .idioms import plainer
from .phrases import DETERMINERS, read_noun
from .sides import read_side
from .tokens import Token, tokenize

# What a distance is counted from, where it does not say how far to walk.
_FROM_THERE = frozenset("before short from away past beyond after off shy".split())
_BORDERS = frozenset("ends begins starts".split())
_INSIDE = frozenset("into inside in".split())
_PLACED = frozenset("is are will on ahead in off behind further".split())
_ANGLES = frozenset("thirty forty forty-five sixty ninety".split())


@dataclass
class _Draft:
    start: int
    stop: int = 0
    verb: str = ""
    side: str = ""
    degree: str = ""
    nouns: list[Noun] = field(default_factory=list)
    distance_m: float = 0.0
    vague: bool = False
    negated: bool = False
    there: bool = False
    until: bool = False
    before: bool = False
    meanwhile: bool = False
    unparsed: int = 0
    pending_side: str = ""

    @property
    def empty(self) -> bool:
        return not (self.verb or self.side or self.nouns or self.distance_m or self.there)

    def done(self) -> Clause:
        return Clause(
            self.start, self.stop, self.verb, self.side, self.degree, tuple(self.nouns),
            self.distance_m, self.vague, self.negated, self.there, self.until, self.before,
            self.meanwhile, self.unparsed,
        )  # fmt: skip


def parse(text: str) -> Parse:
    """Read a text; never fails; words that it cannot place are counted."""
    return _Reader(text).read()


class _Reader:
    def __init__(self, text: str):
        self.text = text
        self.tokens = plainer(tokenize(text))
        self.k = 0
        self.clauses: list[Clause] = []
        self.unparsed: list[str] = []
        self.draft = _Draft(0)
        self.prep = ""

    def read(self) -> Parse:
        while self.k < len(self.tokens):
            self._token()
        self._close()
        words = sum(t.is_word for t in self.tokens)
        return Parse(self.text, tuple(self.clauses), words, tuple(self.unparsed))

    # one step ---------------------------------------------------------------------------------

    def _token(self) -> None:
        token = self.tokens[self.k]
        word = token.text
        if not token.is_word:
            if word in ".;!?:":
                self._close()
            elif word in ",–—":
                self._comma()
            self.prep = "" if word != "-" else self.prep
            self.k += 1
            return
        if (
            self._by_you()
            or self._side()
            or self._prep_phrase()
            or self._angle()
            or self._distance()
            or self._verb()
        ):
            return
        if word in UNTIL:
            if not self.draft.empty:
                self._close()
            self.draft.until = True
            self.draft.start = token.start
            self.k += 1
        elif word in JOINTS:
            self._joint()
        elif word == "without" and self._subordinate():
            self._close()
            self.draft.negated = True
            self.k += 1
        elif word in ("not", "never", "ignore", "avoid", "skip"):
            if word == "not" or not self.draft.verb:
                self._close_if_verb()
                self.draft.negated = True
            self.k += 1
        elif word in SLIGHT:
            self.draft.degree = "slight"
            self.k += 1
        elif word in SHARP:
            self.draft.degree = "sharp"
            self.k += 1
        elif word == "which" and self.draft.empty and self.clauses and self.clauses[-1].negated:
            self.draft.negated = True  # "not the right door, which leads to the kitchen"
            self.k += 1
        elif word == "alone" and self.draft.verb == "leave":
            self.draft.verb = "see"  # "leave the kitchen on your left alone"
            self._extend(token)
            self.k += 1
        elif word in THERE and self.draft.verb == "stop":
            self.draft.there = True
            self._extend(token)
            self.k += 1
        elif word in ("before", "after") and self._subordinate():
            self._close()
            self.draft.until = True
            self.draft.before = word == "before"
            self.k += 1
        elif word in PREPOSITIONS:
            self.prep = PREPOSITIONS[word]
            stopped = self.draft.verb == "stop"
            if (word == "by" and (stopped or self.draft.nouns)) or (
                word == "alongside" and stopped
            ):
                self.prep = "near"
            turning = self.draft.verb == "turn" and not self.draft.side
            if word == "around" and turning and not self._noun_follows():
                self.draft.side, self.prep = "around", ""
            self._extend(token)
            self.k += 1
        elif not self._noun():
            if word not in FILLERS and not word.isdigit():
                self.unparsed.append(word)
                self.draft.unparsed += 1
            self._extend(token)
            self.k += 1

    # sides ------------------------------------------------------------------------------------

    def _side(self) -> bool:
        """`left`, `to the left`, `on your right-hand side`: of a turn, of the noun, or ahead."""
        found = read_side([t.text for t in self.tokens[self.k : self.k + 6]])
        if found is None:
            return False
        prep, determined, side, k, after = (
            found.prep, found.determined, found.side, found.words, found.after,
        )  # fmt: skip
        self.draft.degree = found.degree or self.draft.degree
        draft = self.draft
        placed = bool(draft.nouns) and draft.nouns[-1].kind in ("object", "door")
        if after == "of" and (prep or placed):
            # "To the left of the sofa": the sofa is then on the walker's other side. "The lamp to
            # the left of the sofa": how the two stand to each other is not known.
            found = read_noun(self.tokens, self.k + k + 1)
            if found is not None:
                noun, stop = found
                other = "right" if side == "left" else "left"
                aside = replace(noun, prep="with") if placed else None
                draft.nouns.append(aside or replace(noun, prep="past", side=other))
                self._take(stop - self.k)
                return True
        if determined and not prep and draft.verb not in ("turn", "move") and not draft.empty:
            return False
        if not prep and not determined and draft.verb not in ("turn", "move", "", "leave", "enter"):
            if side == "right":  # "stop right there", "right next to"
                self.k += 1
                return True
            return False
        if prep and self.k and self.tokens[self.k - 1].text in ("one", "other", "two"):
            self._take(k)  # "a door on the left and one on the right"
            return True
        fresh = not draft.side and not draft.nouns
        bare_turn = fresh and (
            draft.verb == "turn"
            or (draft.verb == "move" and after in ("at", "in", "by", "into", "through"))
            or (draft.empty and after in TURN_PLACE and self._elliptic())
            or (draft.verb == "move" and (draft.degree or self.tokens[self.k - 1].text in KEEP))
            or (after in ("after", "before") and self.tokens[self.k - 1].text == "go")
            or (draft.verb == "move" and self.tokens[self.k - 1].text in ("head", "heading"))
        )
        adverb = not prep and not determined and side == "right" and after in RIGHT_ADVERB
        if adverb and not bare_turn:
            self.k += 1
            return True
        if not prep and determined and after and read_noun(self.tokens, self.k) is not None:
            noun = read_noun(self.tokens, self.k)
            if noun is not None and noun[0].kind in ("door", "object", "room"):
                return False
        if prep == "to" and self.k and self.tokens[self.k - 1].text in ("around", "round"):
            # "Follow the bed around to the right" is a turn of its own.
            self._close()
            self.draft.verb, self.draft.side, self.draft.degree = "turn", side, "some"
            self._take(k)
            return True
        pointing = draft.empty or (draft.verb == "see" and not draft.nouns)
        it = [t.text for t in self.tokens[max(0, self.k - 2) : self.k]]
        if prep == "to" and it in (["around", "it"], ["around", "this"], ["around", "that"]):
            draft.side = side
            self._take(k)
            return True
        if prep in ("on", "to", "at") and pointing and self._side_of_last(side, k):
            return True
        # "Veer right between the chair to the left and …": the side of the chair.
        about_object = bool(draft.side) and bool(draft.nouns) and draft.nouns[-1].kind == "object"
        if prep in ("on", "at", "in", "off") or (
            prep == "to" and draft.nouns and (draft.verb != "turn" or about_object)
        ):
            open_ = bool(draft.nouns) and draft.nouns[-1].side in ("", "ahead")
            if draft.nouns and draft.nouns[-1].side == "behind":
                # "Behind you to the right" says both.
                draft.nouns.append(replace(draft.nouns[-1], side=side))
            elif open_ and draft.nouns[-1].kind != "generic":
                draft.nouns[-1] = replace(draft.nouns[-1], side=side)
            elif draft.verb in ("move", "turn") and not draft.nouns and prep == "to":
                draft.side = side
            else:
                draft.pending_side = side
            self._take(k)
            return True
        if draft.nouns and draft.verb not in ("turn", "move") and prep == "to":
            draft.nouns[-1] = replace(draft.nouns[-1], side=side)
        elif (draft.side and draft.side != "around") or (draft.verb in ("enter", "leave", "pass")):
            self._close()
            self.draft.verb, self.draft.side = "turn", side
        else:
            if draft.verb not in ("turn", "move", ""):
                self._close()
            if self.draft.nouns and self.draft.verb == "move" and not self.draft.negated:
                # "walk past the sofa, left, …" and "go straight and left" are turns of their own.
                self._close()
            self.draft.verb, self.draft.side = "turn", side
        self._take(k)
        return True

    def _by_you(self) -> bool:
        """Return `behind you` and `next to you` say where the thing named before is."""
        words = [t.text for t in self.tokens[self.k : self.k + 4]]
        for said, place in BY_YOU.items():
            if tuple(words[: len(said)]) == said and self.draft.nouns:
                last = self.draft.nouns[-1]
                if place == "behind" and last.side in ("left", "right"):
                    self.draft.nouns.insert(-1, replace(last, prep="past"))
                # "Once the bed on your left is behind you": behind is where it is then.
                self.draft.nouns[-1] = replace(
                    last, side=place if place == "behind" else last.side or place
                )
                self._take(len(said))
                return True
        return False

    def _elliptic(self) -> bool:
        """Return whether a bare side may be a turn: `then left past …`, `…, right at the …`."""
        before = self.tokens[self.k - 1].text if self.k else "."
        if before in ("then", "and", ".", ";"):
            return True
        if before == "," and self.tokens[self.k].text == "left":
            return True  # "right at the sofa" may be an adverb, "left at the sofa" is none
        if before == "," and self.k > 1 and self.tokens[self.k - 2].text in OPENERS:
            return True
        moving = ("turn", "move", "enter", "leave", "")
        return before == "," and bool(self.clauses) and self.clauses[-1].verb in moving

    def _side_of_last(self, side: str, count: int) -> bool:
        """`…, both on the right` and `…, on your right,` say the side of what was just named."""
        words = [t.text for t in self.tokens[max(0, self.k - 3) : self.k]]
        after = self.tokens[self.k + count].text if self.k + count < len(self.tokens) else "."
        several = bool(SEVERAL & set(words))
        closed = words[-1:] == [","] and not after[0].isalnum()
        if not self.clauses or not self.clauses[-1].nouns or not (several or closed):
            return False
        last = self.clauses[-1]
        first = 0 if {"both", "all", "each"} & set(words) else len(last.nouns) - 1
        nouns = tuple(
            replace(n, side=n.side or side) if k >= first else n for k, n in enumerate(last.nouns)
        )
        self.clauses[-1] = replace(last, nouns=nouns)
        self.draft = _Draft(self.draft.start)
        self._take(count)
        return True

    # prepositions, distances, verbs -----------------------------------------------------------

    def _prep_phrase(self) -> bool:
        for words, meaning in PHRASES:
            there = tuple(t.text for t in self.tokens[self.k : self.k + len(words)])
            if there == words:
                if meaning:
                    self.prep = meaning
                self._take(len(words))
                return True
        return False

    def _angle(self) -> bool:
        """Return whether an angle was read: `90 degrees`, `a ninety-degree` left turn."""
        words = [t.text for t in self.tokens[self.k : self.k + 3] if t.text != "-"]
        numeral = words[0].isdigit() or words[0] in _ANGLES
        count = 3 if self._next("-") else 2
        if not numeral or words[1:2] not in (["degree"], ["degrees"]):
            if not words[0].endswith("-degree"):
                return False
            count = 1
        self._take(count)
        return True

    def _distance(self) -> bool:
        """Return `four metres`, `about 3 m`, `a couple of steps`, `a few metres`."""
        words = [t.text for t in self.tokens[self.k : self.k + 9]]
        found = read_distance(words)
        if found is None:
            return False
        after = words[found[2]] if found[2] < len(words) else ""
        if after in _FROM_THERE or (after in _INSIDE and self.draft.verb != "move"):
            # "A metre before the bed": it is not how far to walk.
            self._take(found[2])
            return True
        if words[found[2] - 1] in STEPS and self.draft.verb in ("see", "pass"):
            return False
        self.draft.distance_m, self.draft.vague, count = found
        self._take(count)
        self.prep = ""
        return True

    def _verb(self) -> bool:
        token = self.tokens[self.k]
        word, verb = token.text, VERB_OF.get(token.text)
        if verb is None:
            return False
        before = self.tokens[self.k - 1].text if self.k else "."
        named = bool(self.draft.nouns) and self.draft.nouns[-1].stop == self.k
        if (word in _BORDERS and named) or (word in NOUNLIKE and self._next("of")):
            return False  # "after the rug ends", "at the end of the hallway"
        if before in DETERMINERS or before in ("of", "next", "first", "second"):
            # "the end of", "your left turn", "a sharp turn": nouns here.
            if word in ("turn", "bend", "curve") and self.draft.side:
                self.k += 1
                return True
            if word in NOUNLIKE or verb == "see":
                return False
        if word in NOUNLIKE and before in ("left", "right", "slight", "sharp", "gentle", "hard"):
            self.draft.verb = "turn"
            self._take(1)
            return True
        if verb == "see" and word in ("is", "are"):
            self._close_if_verb() if not self.draft.nouns else None
            self.draft.verb = self.draft.verb or "see"
            self._take(1)
            return True
        if word in ("end", "ends") and self._next("up"):
            self.draft.verb = self.draft.verb or "see"
            self._take(2)
            return True
        if word in ("make", "take") and self._next("your"):
            self.draft.verb = self.draft.verb or "move"
            self._take(3 if self._next("way", 2) else 2)
            return True
        if self.draft.verb and not (self.draft.verb == "move" and word in SECOND):
            self._close()
        self.draft.verb = verb
        if word in BEND_WORDS and not self.draft.degree:
            self.draft.degree = "some"
        if word.endswith("ing") and verb != "stop" and self.clauses and before == ",":
            self.draft.meanwhile = True
        if self.draft.start == 0 and not self.clauses and not self.draft.until:
            self.draft.start = token.start
        self.prep = ""
        self._take(1)
        if word in ("pass", "passing") and self._next("through", 0):
            self.draft.verb = "move"
        return True

    def _noun(self) -> bool:
        found = read_noun(self.tokens, self.k)
        if found is None:
            return False
        noun, stop = found
        if not self.prep and noun.kind == "object" and self._goes_on(stop):
            self.prep = "past"
        noun = replace(noun, prep=self.prep or noun.prep, side=noun.side or self.draft.pending_side)
        self.draft.pending_side = ""
        if noun.kind == "generic" and noun.head in ("left", "right"):
            return False
        self.draft.nouns.append(noun)
        self._take(stop - self.k)
        # "between the sofa and the table": the preposition holds for both.
        and_more = self.k < len(self.tokens) and self.tokens[self.k].text == "and"
        if and_more and (self.prep == "between" or self._noun_after_and()):
            other = read_noun(self.tokens, self.k + 1)
            if other is not None:
                second, stop = other
                self.draft.nouns.append(replace(second, prep=noun.prep))
                self._take(stop - self.k)
        self.prep = ""
        return True

    # joints -----------------------------------------------------------------------------------

    def _comma(self) -> None:
        if not self.draft.empty:
            self._close()

    def _joint(self) -> None:
        # "Ignore the kitchen and the bathroom": neither is to be entered.
        both = self.draft.negated and self._noun_follows() and self.tokens[self.k].text == "and"
        if not self.draft.empty:
            self._close()
        self.draft.negated = both
        self.prep = ""
        self.k += 1

    def _goes_on(self, stop: int) -> bool:
        """Whether a noun that ends at token `stop` goes on a list: `past the bed, the desk`."""
        before = [t.text for t in self.tokens[max(0, self.k - 2) : self.k]]
        listed = before[-1:] == [","] or before == [",", "and"]
        after = self.tokens[stop].text if stop < len(self.tokens) else "."
        last = self.clauses[-1] if self.clauses else None
        past = last is not None and bool(last.nouns) and last.nouns[-1].prep == "past"
        return listed and past and self.draft.empty and after not in _PLACED

    def _noun_after_and(self) -> bool:
        """Return `the sofa and the chair` goes on the phrase; `and the hallway is …` does not."""
        found = read_noun(self.tokens, self.k + 1)
        if found is None or found[0].kind not in ("object",):
            return False
        if self.tokens[self.k + 1].text in VERB_OF:  # "…, and stand by the bed"
            return False
        after = self.tokens[found[1]].text if found[1] < len(self.tokens) else "."
        return after not in ("is", "are", "will")

    def _subordinate(self) -> bool:
        """Return `before you get to …`, `after passing …`."""
        following = self.tokens[self.k + 1].text if self.k + 1 < len(self.tokens) else ""
        return following.endswith("ing") or following in ("you", "it", "they", "that", "they're")

    def _noun_follows(self) -> bool:
        found = read_noun(self.tokens, self.k + 1)
        return found is not None and found[0].kind in (
            "object",
            "room",
            "door",
            "generic",
            "unknown",
        )

    def _next(self, word: str, ahead: int = 1) -> bool:
        k = self.k + ahead
        return k < len(self.tokens) and self.tokens[k].text == word

    def _take(self, count: int) -> None:
        last = self.tokens[self.k + count - 1]
        self._extend(last)
        self.k += count

    def _extend(self, token: Token) -> None:
        if self.draft.empty and not self.draft.until and not self.draft.stop:
            self.draft.start = min(self.draft.start or token.start, token.start)
        self.draft.stop = max(self.draft.stop, token.stop)

    def _close_if_verb(self) -> None:
        if self.draft.verb:
            self._close()

    def _close(self) -> None:
        if not self.draft.empty:
            self.clauses.append(self.draft.done())
        here = self.tokens[self.k].stop if self.k < len(self.tokens) else len(self.text)
        self.draft = _Draft(here)
        self.prep = ""
