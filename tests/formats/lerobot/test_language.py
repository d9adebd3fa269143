"""LeRobot's language column: other wordings of the task, and its parts with their times."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.formats.lerobot.test_conformance import command
from tests.support.lerobot_data import RGB, load, write_unit
from tests.support.rollouts import make_rollout
from vlnpe.formats.convert.dataset import extract_unit, open_dataset
from vlnpe.formats.core.rollout import Rollout
from vlnpe.formats.lerobot import FileLimits, assemble_dataset, read_episode_unit

pytestmark = pytest.mark.usefixtures("offline")
PARTS = {"Go on.": 0.0, "Pass the table.": 1.0, "Stop by the sofa.": 2.0, "Wait there.": 9.0}
TEXT = " ".join(PARTS)
SPEED_M_S = 0.5


def straight(number: int, parts: dict[str, float] | None) -> Rollout:
    """A walk along the reference path at `SPEED_M_S` for 5 s, with the parts of its text."""
    rollout = make_rollout(5.0, number)
    x_m = 1.0 + SPEED_M_S * rollout.time_s
    position = np.stack([x_m, 0 * x_m + 2.0, 0 * x_m + 0.36], axis=1)
    steps = [{"words": words, "claims": []} for words in PARTS]
    told = {"from_m": list(parts.values())} if parts else {}
    record = {"texts": [{"text": "Go."}, {"text": TEXT, "claims": steps, **told}]}
    episode = replace(
        rollout.episode,
        instruction=TEXT,
        extra={"instructions": [TEXT, f"Go, {number}."], "instruction": record},
    )
    return replace(rollout, position_world_m=position, episode=episode)


@pytest.fixture(scope="module")
def units(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("language")
    return [write_unit(folder, straight(n, PARTS if n else None), n) for n in range(3)]


@pytest.fixture(scope="module")
def dataset(units: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("spoken") / "set"
    made: dict[str, Any] = {"provenance": {}, "licence": "mit", "title": "Spoken"}
    assemble_dataset(units, root, **made, limits=FileLimits(data_mb=0.01), language=True)
    assert len(list(root.glob("data/*/*.parquet"))) > 1
    return root


def test_a_part_begins_where_the_one_before_is_done(units: list[Path]) -> None:
    columns = read_episode_unit(units[1]).columns
    # The robot does not come to the last one.
    assert columns["subtasks"] == list(PARTS)[:3]
    expected = [along / SPEED_M_S for along in PARTS.values()][:3]
    np.testing.assert_allclose(columns["subtask_from_s"], expected, atol=0.25)
    assert columns["subtask_from_s"][0] == 0.0
    assert read_episode_unit(units[0]).columns["subtasks"] == []


def test_lerobot_resolves_tasks_and_subtasks(dataset: Path) -> None:
    from lerobot.datasets.language import LANGUAGE_COLUMNS, column_for_style, validate_camera_field
    from lerobot.datasets.language_render import active_at

    data = load(dataset, video_backend="pyav")
    assert data.meta.has_language_columns and len(data) == 3 * 21
    for number in range(3):
        rows = data[21 * number]["language_persistent"]
        assert all(data[21 * number + k]["language_persistent"] == rows for k in (1, 20))
        for row in rows:
            assert column_for_style(row["style"]) == LANGUAGE_COLUMNS[0]
            validate_camera_field(row["style"], row["camera"])
        wordings = [row["content"] for row in rows if row["style"] == "task_aug"]
        assert wordings == [TEXT, f"Go, {number}."] and data[21 * number]["task"] == TEXT
        now = active_at(3.0, persistent=rows, style="subtask")
        assert (now and now["content"]) == (None if number == 0 else "Pass the table.")


def test_it_trains_batches_and_passes_the_doctor(dataset: Path, tmp_path: Path) -> None:
    from lerobot.utils.collate import lerobot_collate_fn
    from torch.utils.data import DataLoader

    loader = DataLoader(
        load(dataset, video_backend="pyav"), batch_size=8, collate_fn=lerobot_collate_fn
    )
    batch = next(iter(loader))
    assert batch[RGB].shape == (8, 3, 64, 96)  # LeRobot renders language before it collates
    done = command("lerobot-doctor", "check", "--ci", dataset, cwd=tmp_path)
    checks = json.loads(done.stdout)["checks"]
    faults = [m["message"] for c in checks for m in c["messages"] if m["severity"] == "FAIL"]
    # The doctor counts an episode's texts as the shape of a feature; LeRobot lets them differ.
    assert len(faults) == 1 and "language_persistent" in faults[0], faults


def test_without_it_frames_are_the_same_and_units_come_back(
    dataset: Path, units: list[Path], tmp_path: Path
) -> None:
    plain = tmp_path / "plain"
    assemble_dataset(units, plain, provenance={}, licence="mit", title="Spoken")
    one, two = (pq.read_table(root / "data") for root in (plain, dataset))
    assert "language_persistent" not in one.column_names
    assert two.select(one.column_names).equals(one)
    assert open_dataset(dataset).features == open_dataset(plain).features
    extract_unit(dataset, 1, tmp_path / "unit")
    back, unit = read_episode_unit(tmp_path / "unit"), read_episode_unit(units[1])
    assert back.rows().equals(unit.rows()) and back.columns == unit.columns
