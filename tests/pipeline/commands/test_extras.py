"""A command names all the extras that it lacks at once, before it does anything."""

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
        (f"ablate {RECIPE}", "train,pretrained"),
        (f"train {RECIPE}", "train"),
        ("collect --writer llm --vision --executor ray --out s3://bucket/run", "cluster,s3,llm"),
        ("convert runs/none --to ros2", "ros2"),
        ("view runs/none", "view"),
    ],
)
def test_all_that_is_missing_is_named_with_one_command(
    words: str, lacking: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words.split()) == 2
    said = capsys.readouterr().err
    assert f"setup EXTRA={lacking}\n" in said
    assert all(f"`{extra}`" in said for extra in lacking.split(","))


@pytest.mark.usefixtures("nothing_installed")
def test_what_a_call_does_not_use_is_not_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["evaluate", str(tmp_path / "none"), "--policy", "random"]) == 2
    assert "extra" not in capsys.readouterr().err
