"""Put events into sentences with their claims."""

import math
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from ..language.claims import Claim, Step
from .grammar import Clause, Phrase, drafts, pick
from .records import PASSES, Event

_CHOICES = 24  # ways to say an event, of which the least used is taken
_OPENERS = ("Then", "Now", "From there,", "Next,", "After that,")
_OPENED, _MOST_OPENED = 0.25, 2
_JOINTS = {
    "terse": (", ", ", then ", " and "),
    "natural": (" and ", ", then ", ", and then "),
    "rich": (" and ", ", then ", ", and then "),
}
_LONGEST = {"terse": 4, "natural": 3, "rich": 2}
_STANDING = ("you ", "start", "begin", "the ", "at the ", "your ")  # in lower case
_WHIM = 0.8  # how much chance decides, so that the texts of two buildings differ
_TOLD = 0.8  # a phrase of another text of the path
_USED = 0.4  # one that the other paths' texts use; this counts with the logarithm of how often
_TWICE = 0.25  # a word of the two clauses before
_NEW = 0.5  # what a word that no text has used yet is worth
_BREVITY = {"terse": 1.2, "natural": 0.35, "rich": 0.0}  # what each word of a clause costs
_FLOW = 0.5  # what a clause is worth that goes on with the one before
# "Walk on for two metres." says too little for a sentence: what it leads to goes with it.
_LEADING = frozenset(("walk", "follow"))


class Usage:
    """Counts of the phrases and runs of up to four words that were used, to repeat few of them."""

    def __init__(self) -> None:
        """Start with nothing used."""
        self.counts: Counter[tuple[str, ...]] = Counter()
        self.phrases: Counter[Phrase] = Counter()
        self._judged: dict[str, float] = {}

    def add(self, text: str, phrases: Iterable[Phrase]) -> None:
        """Count a text and its phrases."""
        self.counts.update(_runs(text))
        self.phrases.update(phrases)
        self._judged.clear()

    def repetition(self, text: str) -> float:
        """Return how much of a text was used before: the mean logarithm of its counts."""
        if text not in self._judged:
            runs = _runs(text)
            total = sum(math.log1p(self.counts[run]) for run in runs)
            self._judged[text] = total / max(1, len(runs))
        return self._judged[text]


@lru_cache(maxsize=4096)
def _runs(text: str) -> tuple[tuple[str, ...], ...]:
    words = text.lower().replace(",", "").replace(".", "").split()
    return tuple(
        tuple(words[k : k + n]) for n in (1, 1, 2, 2, 3, 4) for k in range(len(words) - n + 1)
    )


@dataclass
class _Sentence:
    words: str = ""
    claims: list[Claim] = field(default_factory=list)
    clauses: int = 0
    open: bool = True  # another clause may follow


def realize(
    events: Sequence[Event], voice: str, rng: np.random.Generator, usage: Usage,
    told: Collection[Phrase] = (),
) -> tuple[tuple[Step, ...], tuple[Phrase, ...]]:  # fmt: skip
    """Return the sentences of a text with their claims, the stop in the last, and their phrases.

    Args:
        told: the phrases of the other texts of the path, which are said again least.
    """
    clauses: list[Clause] = []
    for event in events:
        ways = drafts(event, voice, rng, _CHOICES, clauses[-1] if clauses else None)
        own = {clause.words.split()[0] for clause in clauses[-3:]}
        said = {word for clause in clauses[-2:] for word in clause.words.split() if len(word) > 4}

        def worse(clause: Clause, own: set[str] = own, said: set[str] = said) -> float:
            words = clause.words.split()
            new = min(2, sum(not usage.counts[word,] for word in words)) * (voice != "terse")
            again = 1.5 * usage.repetition(clause.words) + 0.4 * (words[0] in own) - _NEW * new
            again += _TWICE * len(said & set(words)) + _TOLD * (clause.phrase in told)
            again += _USED * math.log1p(usage.phrases[clause.phrase])
            again += _BREVITY[voice] * len(words) + _WHIM * float(rng.random())
            return again - _FLOW * (clause.phrase.joint in ("&", "+"))

        clauses.append(min(ways, key=worse))
    phrases = tuple(clause.phrase for clause in clauses)
    return _sentences(clauses, voice, rng), phrases


def _sentences(clauses: Sequence[Clause], voice: str, rng: np.random.Generator) -> tuple[Step, ...]:
    done: list[_Sentence] = [_Sentence()]
    opened = 0
    for k, clause in enumerate(clauses):
        now, leading = done[-1], k > 0 and clauses[k - 1].event.kind in _LEADING
        before = clauses[k - 1].phrase.joint if k else ""
        joint = clause.phrase.joint
        if joint == "+" and before not in ("&", "+"):
            now.words += f" {clause.words}"
        elif before == "^" or joint in ("&", "+"):
            now.words += f", {clause.words}"
        elif not now.words:
            now.words = clause.words
        elif clause.event.kind == "too_far":
            now.words += f". {_upper(clause.words)}"
        elif _continues(now, clause, voice, rng, leading=leading):
            within = leading and clause.event.kind.startswith(PASSES)
            now.words += (" and " if within else _joint(now, clause, voice, rng)) + clause.words
        else:
            words = clause.words
            moved = not now.words.lower().startswith(_STANDING) and "then" not in now.words.split()
            # What one sees from a place is not reached before what comes next.
            moved = moved and not (now.claims and now.claims[-1].kind == "see")
            plain = clause.phrase.joint == "" and not {"then", "next"} & set(words.split())
            if (
                plain
                and voice != "terse"
                and moved
                and not clause.event.kind.startswith("stop")
                and opened < _MOST_OPENED
                and rng.random() < _OPENED
            ):
                words = f"{pick(_OPENERS, rng)} {words}"
                opened += 1
            now = _Sentence(words)
            done.append(now)
        now.claims += clause.claims
        now.clauses += 1
        now.open = clause.phrase.joint not in (".",)
    return tuple(Step(f"{_upper(s.words)}.", tuple(s.claims)) for s in done)


def _continues(
    now: _Sentence, clause: Clause, voice: str, rng: np.random.Generator, *, leading: bool
) -> bool:
    """Return whether a clause is joined to the sentence before."""
    if not now.open or clause.phrase.joint in ("<", ".", "^"):
        return False
    if leading:
        return True
    if clause.event.kind.startswith("stop") and voice != "terse" and _full(now.words):
        return False
    weight = now.clauses + now.words.count(" and ") + now.words.count("; ")
    return weight < _LONGEST[voice] and rng.random() < (0.85 if voice == "terse" else 0.5)


def _full(words: str) -> bool:
    return " and " in words or "," in words


def _joint(now: _Sentence, clause: Clause, voice: str, rng: np.random.Generator) -> str:
    """Return what joins a clause; no "leave the hall and turn left and stop"."""
    if _full(now.words) or " and " in clause.words:
        if voice == "terse":
            return ", "
        return ", and " if "then" in now.words.lower().split() else ", then "
    again = "then" in now.words.lower().split()
    joints = [j for j in _JOINTS[voice] if not (again and "then" in j)]
    return pick(joints, rng)


def _upper(text: str) -> str:
    return text[0].upper() + text[1:]
