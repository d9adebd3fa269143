"""Whether a text is an instruction in English at all, and nothing else is hidden in it."""

import re
import unicodedata

from ..language.clauses import Clause, Parse

MIN_WORDS, MAX_WORDS = 6, 90
MAX_CHARACTERS = 700
_FORBIDDEN = re.compile(r"[{}<>\[\]|\\^`~@#$%*_=+]|https?:|www\.|://", re.IGNORECASE)
# "You see the sofa, right?" asks nothing.
_QUESTION = re.compile(
    r"(?:^|[.!?;:] )\W*(?:and |so )?"
    r"(?:wh\w+|how|is|are|do|does|can|could|will|would|should)\b[^.!?]*\?",
    re.IGNORECASE,
)
# "Okay, we want the kitchen" is how people talk on the way.
_FIRST_PERSON = re.compile(
    r"\b(?:I(?! want| need|'d like)|my|sorry|cannot|as an ai)\b", re.IGNORECASE
)
# Words that any English route has some of.
_COMMON = frozenset(
    """the a and to of in on at into left right turn walk go past stop through your you then with
    until from next door room out straight ahead wait continue head by near""".split()
)
_IMPERATIVE = frozenset({"turn", "move", "enter", "leave", "pass"})


_WAYS = frozenset({"along", "through", "into", "past", "to"})


def _leads(clause: Clause) -> bool:
    """Return whether a clause without a verb gives a direction: `straight down the hall, …`."""
    return not clause.verb and any(n.prep in _WAYS for n in clause.nouns)


def form_problems(parse: Parse) -> list[str]:
    """Return what is wrong with a text before any of its claims is looked at."""
    text = parse.text
    problems = []
    if len(text) > MAX_CHARACTERS:
        return [f"{len(text)} characters; at most {MAX_CHARACTERS}"]
    if any(unicodedata.category(c) in ("Cc", "Cf", "Co", "Cs") for c in text):
        return ["control or direction characters"]
    if found := _FORBIDDEN.search(text):
        return [f"{found[0]!r} belongs into no instruction"]
    if not text.isascii():
        letters = [c for c in text if c.isalpha()]
        foreign = sum(not c.isascii() for c in letters)
        if foreign > 0.02 * max(1, len(letters)):
            return ["not in English"]
    if not MIN_WORDS <= parse.words <= MAX_WORDS:
        problems.append(f"{parse.words} words; valid: {MIN_WORDS} … {MAX_WORDS}")
    words = re.findall(r"[a-z']+", text.lower())
    if words and sum(w in _COMMON for w in words) < 0.18 * len(words):
        return ["not in English"]
    if _QUESTION.search(text):
        problems.append("a question is no instruction")
    if found := _FIRST_PERSON.search(text):
        problems.append(f"{found[0]!r}: an instruction does not speak of itself")
    if not any(c.verb in _IMPERATIVE or c.side or _leads(c) for c in parse.clauses):
        problems.append("not an instruction: no part of it says to move")
    if len(parse.unparsed) > max(2, 0.2 * parse.words):
        odd = ", ".join(parse.unparsed[:4])
        problems.append(f"words that belong into no route: {odd}")
    sentences = [s.strip().lower() for s in re.split(r"[.!;]", text) if s.strip()]
    if len(sentences) != len(set(sentences)):
        problems.append("a sentence is repeated")
    content = [w for w in words if w not in ("the", "and", "a", "your", "to", "of")]
    if content and max(content.count(w) for w in set(content)) > max(5, 0.2 * len(words)):
        problems.append("one word is repeated over and over")
    return problems
