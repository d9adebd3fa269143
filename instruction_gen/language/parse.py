"""A small grammar of route instructions.

    text    := clause { joint clause }
    joint   := "." | "," | ";" | "and" | "then" | "until" | "once" | "when" | "before" | "after" | …
    clause  := [verb] { direction | distance | [preposition] noun [place] | adverb }
    place   := ("on" | "to") ("your" | "the") side

Verbs, prepositions and sides come from tables, nouns from the lexicon. A noun that is in neither
is kept as `unknown`, because a text must not mention things that do not exist.
"""

from dataclasses import replace

from .clauses import Parse
from .distances import STEPS, read_distance
from .function_words import (
    BEND_WORDS,
    FILLERS,
    JOINTS,
    NOUNLIKE,
    PHRASES,
    PREPOSITIONS,
    SECOND,
    SHARP,
    SLIGHT,
    THERE,
    UNTIL,
    VERB_OF,
)
from .phrases import DETERMINERS, read_noun
from .side_reader import SideReader

# What a distance is counted from, where it does not say how far to walk.
_FROM_THERE = frozenset("before short from away past beyond after off shy".split())
_BORDERS = frozenset("end ends begins starts".split())
_FINISHES = frozenset("finish finishes finished end ends stops".split())
_INSIDE = frozenset("into inside in".split())
_PLACED = frozenset("is are will on ahead in off behind further".split())
_ANGLES = frozenset("thirty forty forty-five sixty ninety".split())


def parse(text: str) -> Parse:
    """Read a text. This never fails; words that fit nowhere are counted."""
    return _Reader(text).read()


# By their first word, in order.
_PHRASES = {first: [one for one in PHRASES if one[0][0] == first] for (first, *_), _ in PHRASES}


class _Reader(SideReader):
    """Reads a text token by token; what the methods share is in `Cursor`."""

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
        elif word in ("not", "never", "ignore", "avoid", "skip", "nor"):
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
            if self.prep == "with":
                self.draft.pending_side = ""  # "it is on your left, with the bin on your right"
            stopped = self.draft.verb == "stop"
            opens = self.draft.verb == "see" or self.k == 0 or self.tokens[self.k - 1].text in ".:;"
            if (word == "by" and (stopped or self.draft.nouns or opens)) or (
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

    # prepositions, distances, verbs -----------------------------------------------------------

    def _prep_phrase(self) -> bool:
        for words, meaning in _PHRASES.get(self.tokens[self.k].text, ()):
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
        """Take a distance: `four metres`, `about 3 m`, `a couple of steps`, `a few metres`."""
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
        if self.draft.until and word in _FINISHES and (named or before in ("it", "is")):
            return False  # "when the table is finished", "until it finishes"
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
        if word.endswith("ing"):
            self.draft.pending_side = ""  # "always on your left, passing the plant"
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
        if self.prep == "in" and noun.kind == "door" and self.draft.verb == "move":
            self.prep = "into"  # "go in the second door"
        noun = replace(noun, prep=self.prep or noun.prep, side=noun.side or self.draft.pending_side)
        self.draft.pending_side = ""
        if noun.kind == "generic" and noun.head in ("left", "right"):
            return False
        said = self.clauses[-1].nouns[-1:] if self.clauses else ()
        if noun.kind == "door" and self.tokens[self.k].text in ("that", "this") and not noun.side:
            # "There is a door on the left; take that one."
            noun = replace(noun, side=next((n.side for n in said if n.kind == "door"), ""))
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
        """Return whether a noun that ends at token `stop` continues a list: `past the bed, …`."""
        before = [t.text for t in self.tokens[max(0, self.k - 2) : self.k]]
        listed = before[-1:] == [","] or before == [",", "and"]
        after = self.tokens[stop].text if stop < len(self.tokens) else "."
        last = self.clauses[-1] if self.clauses else None
        past = last is not None and bool(last.nouns) and last.nouns[-1].prep == "past"
        return listed and past and self.draft.empty and after not in _PLACED

    def _noun_after_and(self) -> bool:
        """Return whether `and` continues the phrase, as in `the sofa and the chair`.

        It does not in `… and the hallway is …`.
        """
        found = read_noun(self.tokens, self.k + 1)
        kinds = ("object", "room", "door") if self.prep == "past" else ("object",)
        if found is None or found[0].kind not in kinds:
            return False
        if self.tokens[self.k + 1].text in VERB_OF:  # "…, and stand by the bed"
            return False
        after = self.tokens[found[1]].text if found[1] < len(self.tokens) else "."
        return after not in ("is", "are", "will")

    def _subordinate(self) -> bool:
        """Return whether a clause follows: `before you get to …`, `after passing …`."""
        following, second = [*(t.text for t in self.tokens[self.k + 1 : self.k + 3]), "", ""][:2]
        if following in ("it", "that", "them") and second in VERB_OF and second not in _BORDERS:
            return False  # "After it take the door on the left"
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
