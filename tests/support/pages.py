"""The commands that README, CONTRIBUTING and docs show."""

import re
import shlex
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md")))


def blocks(page: Path, language: str) -> list[str]:
    """Return the text of each block of code of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)


def commands(page: Path) -> list[list[str]]:
    """Return the words of each command in the shell blocks, but not of lines with placeholders."""
    lines = (
        line for block in blocks(page, "sh") for line in block.replace("\\\n", " ").splitlines()
    )
    listed = [shlex.split(line, comments=True) for line in lines if not re.search("[<…]", line)]
    for words in listed:
        while words and "=" in words[0]:  # variables of the environment
            del words[0]
    return [words for words in listed if words]
