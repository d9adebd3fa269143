"""Recipes: anchor bombs, recursion, invalid numbers, and data patterns."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.security.hostile import not_files, put, refusal
from tests.security.test_inputs import bomb
from vlnpe.datasets.mixture.choice import Library
from vlnpe.datasets.mixture.recipe import read_recipe
from vlnpe.formats.core.errors import InputError


@not_files
def test_only_regular_files_are_read(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "recipe.yaml"
    complaint = put(kind, path)
    assert complaint in refusal(lambda: read_recipe(path)).reason


SOUND: dict[str, Any] = {
    "recipe": 1,
    "title": "t",
    "sources": {"a": {"robots": ["h1"]}},
    "mixtures": {"m": ["a"]},
}


def test_the_sound_recipe_is_read(tmp_path: Path) -> None:
    path = tmp_path / "recipe.yaml"
    path.write_text(json.dumps(SOUND))
    assert read_recipe(path).title == "t"


@pytest.mark.parametrize(
    "text",
    [
        bomb(9),
        bomb(9, merge=True),
        # Small enough to be read; what is wrong must not be printed as a whole.
        "recipe: 1\n" + bomb(4),
        "recipe: 1\nsources: {x: 1}\nmixtures: " + json.dumps(["a" * 100_000]),
        "recipe: " + json.dumps(["a"] * 5_000),
        "a: &a [*a]",
        "- " * 50_000,
        "{a: " * 50_000,
        "recipe: !!python/object/apply:os.system ['true']",
        "recipe: 1\nsources: {? [a, b] : 1}",
        "",
        "5",
        "\x00",
    ],
)
def test_bombs_and_junk_are_refused_in_one_short_line(text: str, tmp_path: Path) -> None:
    path = tmp_path / "recipe.yaml"
    path.write_text(text)
    refusal(lambda: read_recipe(path))


@pytest.mark.parametrize(
    "changes",
    [
        {"title": ["t"]},
        {"title": None},
        {"seed": -1},
        {"seed": 1.5},
        {"holdout": ["auto"]},
        {"holdout": {"a": 1}},
        {"holdout_fraction": float("nan")},
        {"holdout_fraction": float("inf")},
        {"sources": {"a": {"fraction": float("nan")}}},
        {"sources": {"a": {"robots": [["h1"]]}}},
        {"sources": {"a": 5}},
        {"sources": []},
        {"mixtures": {"m": [["a"]]}},
        {"mixtures": {"m": [{}]}},
        {"mixtures": {"m": {"a": float("inf")}}},
        {"mixtures": {"m": {"a": float("nan")}}},
        {"mixtures": {"m": {"a": True}}},
        {"mixtures": {"m": {"sources": ["a"], "shares": ["size"]}}},
        {"mixtures": {"m": {"x" * 100_000: 1}}},
        {"evaluate": "nobody"},
        {"evaluate": 5},
        {"compare": [["m"]]},
        {"compare": "mm"},
        {"train": 5},
        {"x" * 100_000: 1},
        {"sources": {f"s{k}": {} for k in range(5000)}, "mixtures": {"m": ["t"]}},
    ],
)
def test_wrong_values_are_refused(changes: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "recipe.yaml"
    path.write_text(json.dumps(SOUND | changes).replace("NaN", ".nan").replace("Infinity", ".inf"))
    refusal(lambda: read_recipe(path))


@pytest.mark.parametrize("pattern", ["", ".", "/", "a\0b", "a**b", "[", "http://host/x"])
def test_patterns_find_datasets_or_are_refused(pattern: str, tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    with pytest.raises(InputError):
        Library(tmp_path / "runs").find([pattern])


@pytest.mark.parametrize("pattern", ["../*", "a/../../*", "{root}/other", "C:\\other", "**/../**"])
def test_patterns_stay_in_the_folder_that_the_user_named(pattern: str, tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    (tmp_path / "other" / "meta").mkdir(parents=True)
    (tmp_path / "other" / "meta" / "info.json").write_text("{}")
    with pytest.raises(InputError, match="leads out of"):
        Library(tmp_path / "runs").find([pattern.format(root=tmp_path)])
