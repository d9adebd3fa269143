"""The words for stairs in the languages of RxR (English, Hindi, Telugu) and in Chinese."""

import re
import unicodedata

_STAIRS = {
    "en": r"\b(stairs?|stair(case|well|way)s?|upstairs|downstairs|escalators?|flights? of"
    r"|(up|down|climb|descend|ascend)( \w+){0,3} steps)\b",
    # Written with and without the dot below, and with a short or a long first vowel.
    "hi": r"स[िी]ढ़?[िी]|ज़ीन[ेाों]|सोपान|(स्टे|स्टै)यर|एस्क[ेै]ल[ेै]टर",
    "te": r"మెట్[లట]|మెట్ల|స్టె?య?ిర్|ఎస్కలేటర్|ఎస్కులేటర్",
    "zh": r"楼梯|樓梯|台阶|臺階|台階|阶梯|階梯|扶梯|上楼|下楼|上樓|下樓",
}
_SCRIPTS = {"LATIN", "DEVANAGARI", "TELUGU", "CJK"}
_PATTERNS = {
    language: re.compile(unicodedata.normalize("NFC", words), re.IGNORECASE)
    for language, words in _STAIRS.items()
}


def stair_word(text: str) -> str:
    """Return the first word for stairs in a text, in whichever of the languages; empty if none."""
    text = unicodedata.normalize("NFC", text)
    matches = (pattern.search(text) for pattern in _PATTERNS.values())
    return next((match[0] for match in matches if match), "")


def unknown_language(text: str, declared: str = "") -> str:
    """Return the language of a text if its words for stairs are unknown, else an empty text.

    Args:
        declared: its language as its file states it, such as `te-IN`; empty if it does not. What
            is written in Latin letters is then taken for English.
    """
    code = declared.replace("_", "-").split("-")[0].lower() or "en"
    if code not in _STAIRS:
        return declared
    letters = [unicodedata.name(letter, "UNKNOWN") for letter in text if letter.isalpha()]
    scripts = [name.split()[0].partition("-")[0] for name in letters]
    if not scripts:
        return declared or "no letters"
    script = max(sorted(set(scripts)), key=scripts.count)
    if script not in _SCRIPTS:
        return f"{script.title()} script"
    return f"{declared} in Latin letters" if script == "LATIN" and code != "en" else ""
