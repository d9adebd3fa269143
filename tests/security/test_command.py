"""The command line: hostile inputs end in one line and code 2, never in a traceback."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.security.hostile import DEEP_JSON, not_files, put
from tests.security.test_inputs import bomb
from vlnpe.pipeline.cli import main

pytestmark = pytest.mark.chain


def refused(capfd: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(arguments) == 2
    error = capfd.readouterr().err
    assert "Traceback" not in error
    (line,) = [line for line in error.splitlines() if line.startswith("vlnpe: error:")]
    assert len(line) < 1500
    return line


@not_files
@pytest.mark.parametrize("verb", ["repair", "filter", "convert"])
def test_paths_that_are_no_files_are_named(
    verb: str, kind: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    name = {"repair": "a.glb", "filter": "a.json.gz", "convert": "a.mcap"}[verb]
    complaint = put(kind, tmp_path / name)
    more = ("--to", "lerobot") if verb == "convert" else ()
    line = refused(capfd, verb, str(tmp_path / name), "--out", str(tmp_path / "out"), *more)
    if verb != "convert":
        assert complaint in line
    assert not (tmp_path / "out").exists()


def test_a_name_that_is_not_utf8_is_reported(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = os.fsdecode(os.fsencode(tmp_path) + b"/\xff.glb")
    Path(path).write_bytes(b"")
    assert "not UTF-8" in refused(capfd, "repair", path, "--out", str(tmp_path / "out"))


RECIPES: dict[str, Callable[[], str]] = {
    "anchors": lambda: bomb(9),
    "nesting": lambda: "- " * 50_000,
    "junk": lambda: "\x00",
}


@pytest.mark.parametrize("kind", RECIPES)
def test_hostile_recipes(kind: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.yaml").write_text(RECIPES[kind]())
    refused(capfd, "mix", str(tmp_path / "a.yaml"), "--data", str(tmp_path), "--dry-run")


def test_hostile_datasets(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "set" / "meta" / "episodes").mkdir(parents=True)
    (tmp_path / "set" / "meta" / "info.json").write_text(DEEP_JSON)
    arguments = ("--to", "mcap", "--out", str(tmp_path / "out"))
    assert "nested too deeply" in refused(capfd, "convert", str(tmp_path / "set"), *arguments)


def test_scenes_linked_in_a_circle(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "scans").mkdir()
    (tmp_path / "scans" / "again").symlink_to(tmp_path / "scans")
    arguments = ("--scenes", str(tmp_path / "scans"), "--out", str(tmp_path / "run"))
    assert "contains no scan" in refused(capfd, "collect", *arguments)
