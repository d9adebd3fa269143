"""A command names all the extras that it lacks at once, before it does anything."""

import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.pages import ROOT
from vlnpe.pipeline import extras
from vlnpe.pipeline.cli import main

RECIPE = ROOT / "benchmarks" / "evidence" / "recipes" / "pretrained.yaml"


@pytest.fixture
def nothing_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda name: None)


@pytest.mark.usefixtures("nothing_installed")
@pytest.mark.parametrize(
    ("words", "lacking"),
    [
        ("serve cma-robots", "evaluate,train,pretrained"),
        ("evaluate runs/none --policy cma --executor slurm", "cluster,train"),
        ("adapt builtin --policy cma-robots", "train,pretrained"),
        ("benchmark --policy 'stop, cma'", "train"),
        (f"ablate {RECIPE}", "train,pretrained"),
        (f"train {RECIPE}", "train"),
        ("collect --writer llm --vision --executor ray --out s3://bucket/run", "cluster,s3,llm"),
        ("convert runs/none --to ros2", "ros2"),
        ("view runs/none", "view"),
        ("push runs/none --repo me/x --yes", "train"),
    ],
)
def test_all_that_is_missing_is_named_with_one_command(
    words: str, lacking: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(shlex.split(words)) == 2
    said = capsys.readouterr().err
    assert f"setup EXTRA={lacking}\n" in said
    assert all(f"`{extra}`" in said for extra in lacking.split(","))


RECIPE_TEXT = """
recipe: 1
title: t
sources: {all: {}}
mixtures: {all: {all: 1}}
comparison:
  tests: {h1: {robot: h1}}
  rows:
    scratch: {mixture: all}
    pretrained: {mixture: all, train: {model: {encoder: timm/x}}}
train: {model: %s}
"""


@pytest.fixture
def lacking_pretrained(monkeypatch: pytest.MonkeyPatch) -> None:
    missing = ("timm", "tokenizers")
    monkeypatch.setattr(extras, "find_spec", lambda name: None if name in missing else name)


@pytest.mark.usefixtures("lacking_pretrained")
@pytest.mark.parametrize(
    ("model", "words", "asked"),
    [
        ("{}", "ablate", True),
        ("{}", "ablate --rows scratch", False),
        ("{inputs: [depth, instruction]}", "ablate", False),
        ("{}", "train", False),
        ("{encoder: timm/x}", "train", True),
        ("{encoder: timm/x}", "train --inputs depth,instruction", False),
        ("{encoder: timm/x, inputs: [depth, instruction]}", "train", False),
        ("{language: sentence-transformers/x, inputs: [rgb]}", "train", False),
        ("{encoder: 5}", "train", False),
        ("{encoder: [timm/x]}", "ablate", False),
        ("cma", "train", False),
        ("cma", "ablate", False),
    ],
)
def test_an_encoder_is_asked_for_where_it_is_used(
    model: str,
    words: str,
    asked: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("r.yaml").write_text(RECIPE_TEXT % model)
    verb, *more = words.split()
    Path("none").mkdir()
    assert main([verb, "r.yaml", "--data", "none", "--out", "out", *more]) == 2
    said = capsys.readouterr().err
    assert ("`pretrained`" in said) == asked, said
    assert said.startswith("vlnpe: error: ")


def test_a_missing_folder_is_told_without_seconds_of_imports() -> None:
    code = "import sys; from vlnpe.pipeline.cli import main; code = main(sys.argv[1:])"
    code += "; assert code == 2 and 'numpy' not in sys.modules"
    words = ["evaluate", "nowhere", "--policy", "random"]
    subprocess.run([sys.executable, "-c", code, *words], check=True)
