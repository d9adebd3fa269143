"""A run of several splits: each path is walked once, with all of its instructions."""

import json
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests.support.runs.work import InlineWorkers
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.vlnce.files import read_episodes
from vlnpe.instruction_gen.records import InstructConfig
from vlnpe.pipeline.collect import episode_chain, rollout_chain
from vlnpe.pipeline.collect.run import Run
from vlnpe.pipeline.engine.ledger import Ledger
from vlnpe.pipeline.engine.run_folder import RunFolder
from vlnpe.pipeline.execution.runner import Context
from vlnpe.pipeline.inputs.views import chosen_views
from vlnpe.pipeline.report.gather import robot_rows
from vlnpe.pipeline.stages.scenes import items as scene_items
from vlnpe.rendering.camera.extras import Extras
from vlnpe.rendering.camera.views import CameraOverrides
from vlnpe.trajectory_sampler.config import SampleConfig
from vlnpe.trajectory_sampler.vlnce.align_config import AlignConfig
from vlnpe.trajectory_sampler.vlnce.stairs import StairRules

pytestmark = pytest.mark.slow

QUOTAS = {"a": {"train": 2, "val_seen": 1}, "b": {"val_unseen": 1}}
CONFIG = SampleConfig(
    min_length_m=4.0, min_gap_m=0.8, family_gap_m=1.0, relax=False, min_view_m=0.0
)
WORDING = episode_chain.Wording(InstructConfig(), get_robot("aliengo"))


def start(root: Path, two_rooms, per_instruction: bool = False) -> tuple[Run, dict]:
    for name in QUOTAS:
        if not (root / "scenes" / name).exists():
            shutil.copytree(two_rooms.root, root / "scenes" / name)
            index = root / "scenes" / name / "scene.json"
            index.write_text(index.read_text().replace('"two_rooms"', f'"{name}"'))
    folder = RunFolder(root)
    context = Context(Ledger(root), InlineWorkers(1), progress=False)
    return Run(folder, context, 0, per_instruction=per_instruction), scene_items.rows_of(
        root / "scenes"
    )


def collect(run: Run, asked, scenes) -> Path:
    robot = get_robot("aliengo")
    small = CameraOverrides(width_px=64, height_px=64)
    (view,) = chosen_views("ego", "baked", "embree", robot, small)
    product = rollout_chain.Product(4, Extras(False, False), False, "h264", "video")
    rollout_chain.collect(run, asked, scenes, (robot, "flash"), [view], product, {})
    return run.folder.root / "lerobot" / f"aliengo-flash-{view.name}"


def columns(dataset: Path) -> dict:
    names = ["episode_id", "split", "instructions", "instruction_episode_ids", "tasks"]
    file = dataset / "meta/episodes/chunk-000/file-000.parquet"
    return pq.read_table(file, columns=names).to_pydict()


@pytest.fixture(scope="module")
def sampled(two_rooms, tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("sampled")
    run, scenes = start(root, two_rooms, per_instruction=True)
    asked = episode_chain.sampled(run, WORDING, CONFIG, scenes, QUOTAS)
    assert len(asked) == 4
    collect(run, asked, scenes)
    return root


def test_files_and_datasets_may_have_one_episode_per_instruction(sampled):
    files = {p.name: read_episodes(p) for p in (sampled / "episodes").glob("*.json.gz")}
    counts = {name: len(episodes) for name, episodes in files.items()}
    assert counts == {"train.json.gz": 6, "val_seen.json.gz": 3, "val_unseen.json.gz": 3}
    (dataset,) = (sampled / "lerobot").iterdir()
    found = columns(dataset)
    assert len(found["episode_id"]) == 12
    assert len(set(found["episode_id"])) == 12
    assert all(len(texts) == 1 for texts in found["instructions"])
    walked = list((sampled / "rollouts").rglob("*.mcap"))
    assert len(walked) == 4  # walked once
    (row,) = robot_rows(Ledger(sampled))
    assert (row.episodes, row.instructions) == (4, 12)


def test_published_splits_hold_out_nothing_more(sampled):
    (dataset,) = (sampled / "lerobot").iterdir()
    splits = json.loads((dataset / "meta/splits.json").read_text())
    assert {name: len(some) for name, some in splits.items()} == {
        "train": 6, "val_seen": 3, "val_unseen": 3,
    }  # fmt: skip


def test_files_of_several_splits_are_walked_once_per_path(sampled, two_rooms, tmp_path):
    run, scenes = start(tmp_path, two_rooms)
    files = sorted((sampled / "episodes").glob("*.json.gz"))
    asked = episode_chain.aligned(
        run, WORDING, files, scenes, StairRules(), AlignConfig(robot_radius_m=0.3)
    )
    assert [len(path.extra["instructions"]) for path in asked] == [3, 3, 3, 3]
    found = columns(collect(run, asked, scenes))
    assert len(found["episode_id"]) == 4
    originals = [e.episode_id for file in files for e in read_episodes(file)]
    exported_ids = [name for ids in found["instruction_episode_ids"] for name in ids]
    assert sorted(exported_ids) == sorted(originals)
    assert [texts[0] for texts in found["instructions"]] == [t for (t,) in found["tasks"]]
    back = {
        e.episode_id for p in (tmp_path / "episodes").glob("*.json.gz") for e in read_episodes(p)
    }
    assert back == set(originals)
