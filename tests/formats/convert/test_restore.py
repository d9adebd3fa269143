"""Datasets that LeRobot's own tools edited stay usable, and `vlnpe restore` makes them whole."""

import json
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.support.lerobot_data import write_units
from vlnpe.datasets.episode_index import read_index
from vlnpe.datasets.selection import select_all
from vlnpe.datasets.sequences import EpisodeSequences, SequenceConfig
from vlnpe.datasets.tokens import training_tokens
from vlnpe.formats.convert.dataset import open_dataset
from vlnpe.formats.convert.episodes import mcap_from_unit, unit_from_dataset
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.lerobot import assemble_dataset
from vlnpe.formats.lerobot.episode_columns import EPISODE_COLUMNS, LATER_COLUMNS
from vlnpe.pipeline.cli import main
from vlnpe.pipeline.publish import plan_release

SECONDS = (1.5, 1.0, 2.0, 0.5)
PROVENANCE = {"scenes": {"two_rooms": {"licence": "MIT", "sha256": "ab"}}, "seed": 7}
EDITS = {"deleted": [0, 2, 3], "split": [2, 3], "merged": [2, 3, 0, 2, 3]}


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("original")
    assemble_dataset(
        write_units(folder, SECONDS),
        folder / "set",
        provenance=PROVENANCE,
        licence="mit",
        title="Rooms",
    )
    return folder / "set"


@pytest.fixture(scope="module")
def edited(original: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """What LeRobot makes of it; `EDITS` says which episodes are where."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HF_HUB_OFFLINE", "1")
        from lerobot.datasets.dataset_tools import delete_episodes, merge_datasets, split_dataset
        from lerobot.datasets.lerobot_dataset import LeRobotDataset

        folder = tmp_path_factory.mktemp("edited")
        whole = LeRobotDataset("vlnpe/set", root=original, video_backend="pyav")
        deleted = delete_episodes(whole, [1], folder / "deleted", "vlnpe/deleted")
        split = split_dataset(whole, {"a": [0, 1], "b": [2, 3]}, folder / "parts")
        merge_datasets([split["b"], deleted], "vlnpe/merged", folder / "merged")
    paths = {
        "deleted": folder / "deleted",
        "split": Path(split["b"].root),
        "merged": folder / "merged",
    }
    return paths


def copy(root: Path, to: Path) -> Path:
    import shutil

    return Path(shutil.copytree(root, to))


def columns(root: Path) -> list[dict[str, Any]]:
    tables = [pq.read_table(path) for path in sorted(root.glob("meta/episodes/*/*.parquet"))]
    rows = [row for table in tables for row in table.to_pylist()]
    rows.sort(key=lambda row: row["episode_index"])
    return [{key: row[key] for key in EPISODE_COLUMNS} for row in rows]


@pytest.mark.parametrize("edit", EDITS)
def test_loaders_read_what_is_left(
    edited: dict[str, Path], original: Path, edit: str, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        index = read_index(edited[edit])
    assert "vlnpe restore" in caplog.text
    selection = select_all([index])
    sequences = EpisodeSequences(
        selection, training_tokens(["walk"], 8), SequenceConfig(images=False)
    )
    whole = EpisodeSequences(
        select_all([original]), training_tokens(["walk"], 8), SequenceConfig(images=False)
    )
    assert len(sequences) == len(EDITS[edit])
    for k, number in enumerate(EDITS[edit]):
        item = sequences[k]
        np.testing.assert_array_equal(item["motion"], whole[number]["motion"])
        assert item["robot"] == "aliengo"
    assert len({index.entry(row).uid for row in range(len(index))}) == len(index)


@pytest.mark.parametrize("edit", EDITS)
def test_restored_datasets_are_whole(
    edited: dict[str, Path], original: Path, edit: str, tmp_path: Path
) -> None:
    root = copy(edited[edit], tmp_path / "set")
    with pytest.raises(FileFormatError, match="vlnpe restore"):
        open_dataset(root)
    assert main(["restore", str(root), "--original", str(original)]) == 0
    truth = columns(original)
    assert columns(root) == [truth[number] for number in EDITS[edit]]
    # What needs all columns works: push, and convert.
    assert plan_release(root, "someone/rooms").refusals == ()
    assert json.loads((root / "meta/provenance.json").read_text()) == PROVENANCE
    assert open_dataset(root).facts.licence == "mit"
    unit_from_dataset(root, 1, tmp_path / "unit")
    mcap_from_unit(tmp_path / "unit", tmp_path / "a.mcap")
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    again: Any = LeRobotDataset("vlnpe/set", root=root, video_backend="pyav")
    assert again.num_episodes == len(EDITS[edit]) and len(again[0]["observation.images.rgb"]) == 3


def test_a_dataset_whose_depth_was_removed_restores(original: Path, tmp_path: Path) -> None:
    from lerobot.datasets.dataset_tools import remove_feature
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    whole = LeRobotDataset("vlnpe/set", root=original, video_backend="pyav")
    remove_feature(whole, "observation.images.depth", tmp_path / "less", "vlnpe/less")
    assert main(["restore", str(tmp_path / "less"), "--original", str(original)]) == 0
    assert columns(tmp_path / "less") == columns(original)
    assert "Depth is planar z" not in (tmp_path / "less" / "README.md").read_text()


def test_an_original_without_later_columns_restores(
    edited: dict[str, Path], original: Path, tmp_path: Path
) -> None:
    older, root = copy(original, tmp_path / "older"), copy(edited["split"], tmp_path / "set")
    (path,) = (older / "meta/episodes").rglob("*.parquet")
    pq.write_table(pq.read_table(path).drop_columns(list(LATER_COLUMNS)), path)
    assert main(["restore", str(root), "--original", str(older)]) == 0
    assert all(row[key] == value for row in columns(root) for key, value in LATER_COLUMNS.items())


def test_an_episode_of_another_dataset_is_named(
    edited: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    units = write_units(tmp_path, (0.75,))
    assemble_dataset(units, tmp_path / "other", provenance={}, licence="mit", title="Other")
    root = copy(edited["split"], tmp_path / "set")
    before = {p: p.read_bytes() for p in root.rglob("*") if p.is_file()}
    assert main(["restore", str(root), "--original", str(tmp_path / "other")]) == 2
    assert "2 episodes (the first is number 0) are in none of" in capsys.readouterr().err
    assert before == {p: p.read_bytes() for p in root.rglob("*") if p.is_file()}
