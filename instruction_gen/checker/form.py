"""Whether a text is an instruction in English at all, and nothing else is hidden in it."""

import re
import unicodedata

from ..language.tables import closed

MIN_WORDS, MAX_WORDS = 3, 300  # RxR has texts of more than 200
MAX_CHARACTERS = 2000
_FORBIDDEN = re.compile(r"[{}<>\[\]|\\^`~@#$%*_=]|https?:|www\.|://", re.IGNORECASE)
_DRAWN = re.compile(r"->|~(?= ?\d)")  # "kitchen -> hall, ~3 m"
_LIST = re.compile(r"(?:^|\s)(?:\d{1,2}|[a-h]|i{1,3}|iv)[.)]\s|(?:^|\n)\s*[-•]", re.IGNORECASE)
# "You see the sofa, right?" asks nothing.
_QUESTION = re.compile(
    r"(?:^|[.!?;:] )\W*(?:and |so )?"
    r"(?:wh\w+|how|is|are|do|does|should|(?:can|could|will|would)(?! you (?!see)))\b[^.!?]*\?",
    re.IGNORECASE,
)
# "I do love that window" is an aside.
_FEELS = rf"(?:'\w+)?(?: \w+){{0,2}} (?:{'|'.join(sorted(closed('feels')))})\b"
_FIRST_PERSON = re.compile(
    rf"\b(?:I(?!{_FEELS})(?:'m|'ve|'ll| am| can\w*| will| do| have)|"
    r"my(?! [\w']+[,.!;])|sorry|cannot|as an ai|certainly|sure thing|"
    r"here is (?:your|the|an) \w*\s*(?:instruction|description|text))\b",
    re.IGNORECASE,
)
_SCRIPT = {"zh": "CJK UNIFIED", "hi": "DEVANAGARI"}
# Words that any English route has some of.
_COMMON = frozenset(
    """the a and to of in on at into left right turn walk go past stop through your you then with
    until from next door room out straight ahead wait continue head by near""".split()
)


def form_problems(text: str) -> list[str]:
    """Return what is wrong with a text before any of its claims is looked at."""
    if len(text) > MAX_CHARACTERS:
        return [f"{len(text)} characters; at most {MAX_CHARACTERS}"]
    if any(unicodedata.category(c) in ("Cc", "Cf", "Co", "Cs") for c in text.replace("\n", " ")):
        return ["control or direction characters"]
    if found := _FORBIDDEN.search(_DRAWN.sub(" ", text)):
        return [f"{found[0]!r} belongs into no instruction"]
    if found := _LIST.search(text):
        return [f"{found[0].strip()!r}: an instruction is no list"]
    letters = [c for c in text if c.isalpha()]
    if sum(not c.isascii() for c in letters) > 0.02 * max(1, len(letters)):
        return ["not in English"]
    words = re.findall(r"[a-z']+", text.lower())
    if not MIN_WORDS <= len(words) <= MAX_WORDS:
        return [f"{len(words)} words; valid: {MIN_WORDS} … {MAX_WORDS}"]
    if sum(w in _COMMON for w in words) < 0.15 * len(words):
        return ["not in English"]
    problems = []
    if _QUESTION.search(text):
        problems.append("a question is no instruction")
    if found := _FIRST_PERSON.search(text):
        problems.append(f"{found[0]!r}: an instruction does not speak of itself")
    sentences = [s.strip().lower() for s in re.split(r"[.!;]", text) if s.strip()]
    if len(sentences) != len(set(sentences)):
        problems.append("a sentence is repeated")
    return problems


def script_problems(text: str, language: str) -> list[str]:
    """Return what is wrong with the characters of a text in Chinese (`zh`) or Hindi (`hi`)."""
    if any(unicodedata.category(c) in ("Cc", "Cf", "Co", "Cs") or c in "{}<>" for c in text):
        return ["control characters or braces"]
    letters = [c for c in text if unicodedata.category(c)[0] == "L"]
    own = sum(unicodedata.name(c, "").startswith(_SCRIPT[language]) for c in letters)
    if len(letters) < 5 or own < 0.8 * len(letters):
        return [f"not in the language asked for ({language})"]
    return []
