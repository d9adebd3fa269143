"""Sides in a text: of a turn, of the noun beside them, or of what comes next."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from .cursor import Cursor, Draft
from .function_words import (
    BY_YOU,
    KEEP,
    OPENERS,
    RIGHT_ADVERB,
    SEVERAL,
    SHARP,
    SLIGHT,
    TURN_PLACE,
)
from .phrases import read_noun

_BEFORE = frozenset(("immediate", "far", "very", "near", "wide", "half")) | SLIGHT | SHARP


@dataclass(frozen=True)
class Side:
    """A side as it is said.

    Attributes:
        side: `left` or `right`.
        prep: `on`, `to`, … before it, "" = none.
        determined: `your`, `the` or `a` stands before it.
        degree: `slight`, `sharp` or "".
        words: how many words it takes.
        after: the word that follows, "" at the end.
    """

    side: str
    prep: str
    determined: bool
    degree: str
    words: int
    after: str


def read_side(words: Sequence[str]) -> Side | None:
    """Return the side that begins a run of words, None when none does."""
    k = 0
    degree = ""
    prep = words[0] if words[0] in ("on", "to", "at", "in", "off") else ""
    if prep:
        k += 1
        while k < len(words) and words[k] in ("off", "over"):
            k += 1
    determined = k < len(words) and words[k] in ("your", "the", "its", "a", "an")
    k += determined
    while k < len(words) and words[k] in _BEFORE:
        if words[k] in SLIGHT | SHARP | {"half"}:
            degree = "sharp" if words[k] in SHARP else "slight"
        k += 1
    if k >= len(words) or words[k] not in ("left", "right", "left-hand", "right-hand"):
        return None
    side = words[k].split("-")[0]
    k += 1
    for following in ("hand", "side"):
        k += k < len(words) and words[k] == following
    return Side(side, prep, determined, degree, k, words[k] if k < len(words) else "")


class SideReader(Cursor):
    """Reads sides at the cursor; each method returns whether it took any words."""

    def _side(self) -> bool:
        """Take a side, as in `to the left` or `on your right`, and find what it belongs to."""
        found = read_side([t.text for t in self.tokens[self.k : self.k + 6]])
        if found is None:
            return False
        prep, determined, side, k, after = (
            found.prep, found.determined, found.side, found.words, found.after,
        )  # fmt: skip
        self.draft.degree = found.degree or self.draft.degree
        draft = self.draft
        placed = bool(draft.nouns) and draft.nouns[-1].kind in ("object", "door")
        if after == "of" and (prep or placed or self._thing_at(self.k + k + 1)):
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
        if not prep and not determined and self._beside_noun(after):
            draft.nouns[-1] = replace(draft.nouns[-1], side=side)
            self._take(k)
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
        if prep == "on" and draft.verb == "turn" and not draft.side and not draft.nouns:
            draft.side = side  # "turn on left side"
            self._take(k)
            return True
        # "Veer right between the chair to the left and …": the side of the chair.
        about_object = bool(draft.side) and bool(draft.nouns) and draft.nouns[-1].kind == "object"
        if prep in ("on", "at", "in", "off") or (
            prep == "to" and draft.nouns and (draft.verb != "turn" or about_object)
        ):
            open_ = bool(draft.nouns) and draft.nouns[-1].side in ("", "ahead", "beside")
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

    def _thing_at(self, k: int) -> bool:
        found = read_noun(self.tokens, k)
        return found is not None and found[0].kind == "object"

    def _beside_noun(self, after: str) -> bool:
        """Return whether a bare side belongs to the noun before it: `keep the sofa left, …`."""
        if not self.draft.nouns or self.draft.nouns[-1].stop != self.k or after[:1].isalpha():
            return after == "and" and self._beside_noun("")
        last = self.draft.nouns[-1]
        kept = KEEP & {t.text for t in self.tokens[max(0, last.start - 2) : last.start]}
        shown = self.draft.verb in ("", "see") and last.prep in ("", "with")
        return last.kind in ("object", "door") and not last.side and (shown or bool(kept))

    def _by_you(self) -> bool:
        """Take `behind you` or `next to you`, which say where the thing named before is."""
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
        if before == "," and self.clauses and self.clauses[-1].verb == "stop":
            return False  # "stop there, right by the picture"
        if before in ("then", "and", ".", ";", "again"):
            return True
        if before == "," and self.tokens[self.k].text == "left":
            return True  # "right at the sofa" may be an adverb, "left at the sofa" is none
        if before == "," and self.k > 1 and self.tokens[self.k - 2].text in OPENERS:
            return True
        moving = ("turn", "move", "enter", "leave", "")
        return before == "," and bool(self.clauses) and self.clauses[-1].verb in moving

    def _side_of_last(self, side: str, count: int) -> bool:
        """Take a side of what was just named: `…, both on the right` or `…, on your right,`."""
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
        self.draft = Draft(self.draft.start)
        self._take(count)
        return True
