"""README, CONTRIBUTING and docs: their commands parse, and the files that they name exist."""

import ast
import re
import subprocess
from pathlib import Path

import pytest

from tests.pipeline.test_packaging import PACKAGES
from tests.support.pages import PAGES, ROOT, commands
from vlnpe.pipeline.cli import VERBS, parse

# `formats/core/frames.py`, but not `scenes/<scene>/` of a run folder.
NAMED = re.compile(r"`([a-z_]+/[\w./-]*\w(?:/|\.\w+))`")
LINK = re.compile(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)")
FOLDERS = {path.name for path in ROOT.iterdir() if path.is_dir()} - {"build", "runs"}


def test_the_pages_stay_short() -> None:
    readme, contributing, *pages = (page.read_text() for page in PAGES)
    assert len(readme.splitlines()) <= 120 and len(readme.split()) <= 900
    assert len(contributing.split()) <= 900
    assert sum(len(text.split()) for text in (readme, contributing, *pages)) <= 30_000


def test_commands_are_found_in_the_pages() -> None:
    words = [words for page in PAGES for words in commands(page)]
    assert {"vlnpe", "make"} <= {first for first, *_ in words} and len(words) > 60


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_of_vlnpe_parse(page: Path) -> None:
    for first, *words in commands(page):
        if first == "vlnpe":
            verb, _ = parse(words)
            assert verb.name in VERBS


def make(*words: str) -> subprocess.CompletedProcess[str]:
    """Let make say what it would do."""
    command = ["make", "-n", *words]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def test_sections_of_the_benchmarks_exist() -> None:
    benchmarks = pytest.importorskip("benchmarks.__main__", exc_type=ImportError)  # needs extras
    text = "".join(page.read_text() for page in PAGES)
    named = re.findall(r"make bench ONLY=(?:\"([^\"]+)\"|(\w+))", text)
    names = {name for found in named for part in found for name in part.split()}
    assert {"fuzz", "durability"} <= names <= benchmarks.SECTIONS.keys()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_targets_and_variables_of_make_exist(page: Path) -> None:
    for first, *words in commands(page):
        if first == "make":
            done = make(*words)
            assert done.returncode == 0, (words, done.stderr)


@pytest.mark.parametrize("words", [["collect", "EPISODE=3"], ["evaluate", "ROBOTS=h1", "OUT=x"]])
def test_unknown_variables_are_refused(words: list[str]) -> None:
    done = make(*words)
    assert done.returncode == 2
    unknown = words[1].split("=")[0]
    assert f"unknown variable {unknown}; valid: ROBOT CONTROLLER " in done.stderr


def test_each_variable_reaches_a_recipe() -> None:
    valid = make("collect", "NO=1").stderr.split("valid: ")[1].rstrip(". Stop\n").split()
    assert {"ROBOT", "EPISODES", "POLICY"} <= {*valid}
    targets = re.findall(r"^([a-z-]+):.*## ", (ROOT / "Makefile").read_text(), re.MULTILINE)
    given = [f"{name}=given-{name}" for name in valid]
    # Some are used only where OUT is not given.
    printed = make(*targets, *given).stdout + make("report", "SEED=given-SEED").stdout
    assert {name for name in valid if f"given-{name}" not in printed} <= {"VERBOSE"}


def test_values_and_variables_of_libraries_are_not_taken_for_variables() -> None:
    words = ["ROBOT=h1", "ARGS=--splits train=3 --count 1", "HF_HUB_OFFLINE=1"]
    done = make("collect", *words)
    assert done.returncode == 0, done.stderr
    assert "--splits train=3 --count 1" in done.stdout


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_files_that_are_named_exist(page: Path) -> None:
    named = {name for name in NAMED.findall(page.read_text()) if name.split("/")[0] in FOLDERS}
    assert {name for name in named if not (ROOT / name).exists()} == set()


@pytest.mark.parametrize("page", PAGES[:2], ids=lambda page: page.name)  # Sphinx checks the others
def test_files_that_are_linked_exist(page: Path) -> None:
    linked = LINK.findall(page.read_text())
    assert {name for name in linked if not (page.parent / name).exists()} == set()


def test_the_page_of_errors_names_every_error_and_its_kind() -> None:
    bases = {
        node.name: [ast.unparse(base) for base in node.bases]
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        if re.search(r"^class .*Error", source := path.read_text(), re.MULTILINE)
        for node in ast.parse(source).body
        if isinstance(node, ast.ClassDef)
    }

    def is_ours(name: str) -> bool:
        return name == "VlnpeError" or any(map(is_ours, bases.get(name, ())))

    page = (ROOT / "docs" / "reference" / "errors.md").read_text()
    rows = dict(re.findall(r"\| `(\w+Error)` \| `(\w+)` \|", page))
    described = re.search(r":members: (.+)", page)
    assert described is not None
    names = {name for name in bases if is_ours(name)}
    assert rows.keys() | set(described[1].split(", ")) == names
    assert rows == {name: bases[name][0] for name in rows}
