"""Texts in other languages than English: their script, and their sides against checked English."""

from __future__ import annotations

import re
import unicodedata

_SCRIPT = {"zh": "CJK UNIFIED", "hi": "DEVANAGARI"}
_LEFT = {"zh": r"左", "hi": r"बाएँ|बाएं|बायीं|बाईं|बायें|बाँए|बाँई"}
_RIGHT = {"zh": r"右", "hi": r"दाएँ|दाएं|दायीं|दाईं|दायें|दाहिन"}
_STOP = {"zh": r"停|等", "hi": r"रुक|रूक|ठहर|प्रतीक्षा|इंतज़ार|इंतजार"}
_SIDES = re.compile(r"\b(left|right)\b", re.IGNORECASE)


def foreign_problems(text: str, language: str, english: str) -> list[str]:
    """What is wrong with a text, given its English, which is checked like any other text.

    The script must be that of the language, it must tell to stop, and its sides must be those of
    the English in the same order. Nouns are not looked up: they are as true as the English is.
    """
    if any(unicodedata.category(c) in ("Cc", "Co", "Cs") or c in "{}<>\u202e\u202d" for c in text):
        return ["control characters or braces"]
    letters = [c for c in text if unicodedata.category(c)[0] == "L"]
    own = sum(unicodedata.name(c, "").startswith(_SCRIPT[language]) for c in letters)
    if len(letters) < 5 or own < 0.8 * len(letters):
        return [f"not in the language asked for ({language})"]
    problems = []
    if not re.search(_STOP[language], text):
        problems.append("it does not say where to stop")
    told = re.findall(f"(?P<left>{_LEFT[language]})|(?P<right>{_RIGHT[language]})", text)
    sides = ["left" if left else "right" for left, _ in told]
    meant = [side.lower() for side in _SIDES.findall(english)]
    if sorted(sides) != sorted(meant):
        problems.append(f"its sides ({', '.join(sides)}) are not the English ({', '.join(meant)})")
    return problems
