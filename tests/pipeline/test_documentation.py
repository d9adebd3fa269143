"""README, CONTRIBUTING and docs: their commands parse, and the files that they name exist."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from vlnpe.pipeline.cli import VERBS, parse

ROOT = Path(__file__).resolve().parents[2]
PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")))
SHELL = re.compile(r"^```sh\n(.*?)^```", re.DOTALL | re.MULTILINE)
# `formats/core/frames.py`, but not `scenes/<scene>/` of a run folder.
NAMED = re.compile(r"`([a-z_]+/[\w./-]*\w(?:/|\.\w+))`")
FOLDERS = {path.name for path in ROOT.iterdir() if path.is_dir()} - {"build", "runs"}
VARIABLE = re.compile(r"\b([A-Z]+)=")


def commands(page: Path) -> list[list[str]]:
    """Return the words of each command in the shell blocks, but not of lines with placeholders."""
    lines = (
        line
        for block in SHELL.findall(page.read_text())
        for line in block.replace("\\\n", " ").splitlines()
    )
    found = [shlex.split(line, comments=True) for line in lines if not re.search("[<…]", line)]
    for words in found:
        while words and "=" in words[0]:  # variables of the environment
            del words[0]
    return [words for words in found if words]


def test_commands_are_found_in_the_pages() -> None:
    words = [words for page in PAGES for words in commands(page)]
    assert {"vlnpe", "make"} <= {first for first, *_ in words} and len(words) > 60


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_of_vlnpe_parse(page: Path) -> None:
    for first, *words in commands(page):
        if first == "vlnpe":
            verb, _ = parse(words)
            assert verb.name in VERBS


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_targets_and_variables_of_make_exist(page: Path) -> None:
    makefile = (ROOT / "Makefile").read_text()
    targets = set(re.findall(r"^([a-z-]+):", makefile, re.MULTILINE))
    variables = set(re.findall(r"\$\((?:origin |or \$\()?([A-Z]+)\b", makefile))
    for first, *words in commands(page):
        if first == "make":
            assert {w for w in words if "=" not in w} <= targets, words
            assert {m[1] for w in words if (m := VARIABLE.match(w))} <= variables, words


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_are_named_exist(page: Path) -> None:
    named = {name for name in NAMED.findall(page.read_text()) if name.split("/")[0] in FOLDERS}
    assert {name for name in named if not (ROOT / name).exists()} == set()
