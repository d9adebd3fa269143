"""Whether claims cover the words that they are delivered with.

Every word of a closed class — sides, rooms, things, doors, ordinals, numbers, negation, verbs that
turn, enter, leave, pass or stop — must be said by a claim of its step. This reads no sentence: it
compares two sets of words.
"""

import re
from collections.abc import Sequence

from ..language.claims import Claim, Step
from ..language.lexicon import OBJECT_PHRASES, ROOM_PHRASES, singular
from ..language.phrases import is_known, noun_kind, number_of, read_phrase
from ..language.reader import read_text
from ..language.tokens import Token, tokenize
from ..language.words import NEGATIONS, ORDINALS, VERB_OF

# Which claims account for a verb.
_VERBS = {
    "stop": {"stop"},
    "enter": {"enter", "in", "door"},
    "leave": {"leave", "door"},
    "pass": {"pass", "see"},
}


def accounting_problems(steps: Sequence[Step], text: str) -> list[tuple[int, str]]:
    """Return what the claims of each step do not cover, with the number of the step."""
    problems: list[tuple[int, str]] = []
    said = " ".join(step.words for step in steps)
    if _bare(said) != _bare(text):
        problems.append((len(steps) - 1, "the words of the steps are not those of the text"))
    stopped = False
    for number, step in enumerate(steps):
        problems += [(number, reason) for reason in _uncovered(step)]
        moves = any(c.kind not in ("stop", "see") for c in step.claims)
        if stopped and (moves or not step.claims):
            problems.append((number, "the text goes on after the stop"))
        stopped = stopped or any(c.kind == "stop" for c in step.claims)
    if not stopped:
        problems.append((len(steps) - 1, "no claim says where to stop"))
    return problems


def _bare(text: str) -> list[str]:
    return re.findall(r"[a-z0-9]+", text.lower())


def _uncovered(step: Step) -> list[str]:
    if not step.claims:
        return [f"{step.words!r:.60} claims nothing"]
    tokens = tokenize(step.words)
    problems = []
    kinds = {c.kind for c in step.claims}
    sides = {c.side for c in step.claims}
    numbers = {float(n) for c in step.claims for n in (c.count, c.ordinal, c.metres) if n}
    for k, token in enumerate(tokens):
        word = token.text
        verb = VERB_OF.get(word, "")
        if word in ("left", "right") and word not in sides:
            problems.append(f"no claim says {word}")
        elif word in NEGATIONS and "avoid" not in kinds:
            problems.append(f"{word}: an instruction says what to do")
        elif (
            (number := number_of(word))
            and not _vague(tokens, k)
            and not any(abs(number - n) < 0.51 for n in numbers)
        ) or (word in ORDINALS and noun_kind(_after(tokens, k)) and ORDINALS[word] not in numbers):
            problems.append(f"no claim says {word}")
        elif noun_kind(word) and not _named(word, step.claims):
            if read_phrase(tokens, k) or noun_kind(word) != "door":
                problems.append(f"no claim is about the {word}")
        elif verb in _VERBS and not kinds & _VERBS[verb] and not _noun_before(tokens, k):
            problems.append(f"no claim says {word}")
        elif not is_known(word):
            problems.append(f"{word} is in no table")
    # A side belongs to its thing: "the sofa on your left and the table on your right".
    for read in read_text(step.words):
        problems += read.faults
        for claim in read.claims:
            if claim.what == "thing" and claim.side in ("left", "right"):
                own = [c for c in step.claims if _same(c, claim)]
                if own and not any(c.side == claim.side for c in own):
                    problems.append(f"no claim says that the {claim.name} is on the {claim.side}")
    return problems


def _after(tokens: Sequence[Token], k: int) -> str:
    return tokens[k + 1].text if k + 1 < len(tokens) else "."


def _noun_before(tokens: Sequence[Token], k: int) -> bool:
    return k > 0 and tokens[k - 1].text in ("a", "the", "your", "to", "without", "dead")


def _vague(tokens: Sequence[Token], k: int) -> bool:
    around = {_after(tokens, k), tokens[k - 1].text if k else ""}
    return tokens[k].text in ("one", "couple", "double", "pair", "half") or bool(
        around & {"of", "or"}
    )


def _named(word: str, claims: Sequence[Claim]) -> bool:
    kind = noun_kind(word)
    if kind == "door":
        return any(c.what in ("door", "room") for c in claims)
    return any(_phrases_meet(word, name) for c in claims for name in (c.name, c.room) if name)


def _same(claim: Claim, other: Claim) -> bool:
    return claim.what == other.what and _phrases_meet(claim.name, other.name)


def _phrases_meet(word: str, name: str) -> bool:
    """Return whether two phrases may name the same kind of thing or room."""
    return bool(_meanings(word) & _meanings(name))


def _meanings(phrase: str) -> frozenset[str]:
    result: set[str] = {singular(phrase)}
    for one in (phrase, singular(phrase), *phrase.split()):
        result |= OBJECT_PHRASES.get(one, frozenset()) | ROOM_PHRASES.get(one, frozenset())
    return frozenset(result)
