"""README, CONTRIBUTING and docs: their commands parse, and the files that they name exist."""

import re
import subprocess
from pathlib import Path

import pytest

from tests.support.pages import PAGES, ROOT, commands
from vlnpe.pipeline.cli import VERBS, parse

# `formats/core/frames.py`, but not `scenes/<scene>/` of a run folder.
NAMED = re.compile(r"`([a-z_]+/[\w./-]*\w(?:/|\.\w+))`")
LINK = re.compile(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)")
FOLDERS = {path.name for path in ROOT.iterdir() if path.is_dir()} - {"build", "runs"}


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


@pytest.mark.parametrize(
    ("words", "unknown", "valid"),
    [
        (["collect", "EPISODE=3"], "EPISODE (did you mean EPISODES?)", "EPISODES"),
        (["collect", "ROBOTS=h1", "SCENE=scan.glb"], "ROBOTS (did you mean ROBOT?)", "ROBOT"),
        (["evaluate", "LIGHT=DL300"], "LIGHT", "POLICY"),
    ],
)
def test_variables_that_a_target_does_not_take_are_refused(
    words: list[str], unknown: str, valid: str
) -> None:
    done = make(*words)
    assert done.returncode == 2
    assert f"unknown variable {unknown}; valid: " in done.stderr
    assert valid in done.stderr.split("valid: ")[1].rstrip(". Stop\n").split()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["colect"], "unknown target colect (did you mean collect?); valid: help setup "),
        (["colect", "ROBOT=h1"], "unknown target colect (did you mean collect?); valid: "),
        (["collect", "tset"], "unknown target tset (did you mean test?); valid: "),
        (["xyzzy", "FOO=1"], "unknown target xyzzy; valid: "),
    ],
)
def test_targets_that_do_not_exist_are_refused(words: list[str], said: str) -> None:
    done = make(*words)
    assert done.returncode == 2
    assert said in done.stderr and "variable" not in done.stderr


def test_help_lists_the_variables_of_each_target_and_recipes_use_them() -> None:
    taken = re.findall(r"^([a-z-]+)_TAKES += (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    help_text = subprocess.run(["make", "help"], cwd=ROOT, capture_output=True, text=True).stdout
    assert {"collect", "dataset-bench", "evaluate"} <= {target for target, _ in taken}
    for target, names in taken:
        listed = help_text.split(f"variables for {target}: ")[1].split("variables for ")[0]
        for name in names.split():
            assert re.search(rf"\b{name}\b", listed), (target, name)
        # Some are used only where OUT is not given.
        for given in ({*names.split()} - {"OUT"}, {*names.split()} & {"OUT"}):
            done = make(target, *(f"{name}=given-{name}" for name in given))
            assert {name for name in given if f"given-{name}" not in done.stdout} == set(), target


def test_every_target_is_known_as_one() -> None:
    rules = re.findall(r"^([a-z-]+):.*## ", (ROOT / "Makefile").read_text(), re.MULTILINE)
    listed = make("xyzzy").stderr.split("valid: ")[1].rstrip(". Stop\n").split()
    assert sorted(listed) == sorted(rules) and rules


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
