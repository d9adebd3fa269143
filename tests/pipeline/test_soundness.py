"""Unsound scenes: reported, refused by `collect`, and listed in report and dataset card."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.support.scenes import scans
from vlnpe.formats.core.camera import CameraModel
from vlnpe.formats.core.errors import SceneError
from vlnpe.formats.lerobot import usage
from vlnpe.formats.lerobot.card import CameraFacts, CardFacts, dataset_card
from vlnpe.formats.lerobot.layout import DEPTH_KEY
from vlnpe.formats.scene import UNSOUND
from vlnpe.formats.scene.bundle import load_bundle
from vlnpe.pipeline.commands import scenes
from vlnpe.pipeline.commands.scenes import Repair, run_repair
from vlnpe.pipeline.engine.ledger import Ledger, Row
from vlnpe.pipeline.engine.work import WorkItem
from vlnpe.pipeline.execution.processes import Workers
from vlnpe.pipeline.execution.runner import Context, run_stage
from vlnpe.pipeline.stages.scenes import items as scene_items
from vlnpe.pipeline.stages.scenes.outputs import facts_of
from vlnpe.pipeline.stages.scenes.soundness import SoundnessJob
from vlnpe.scene_repair.verify.verdict import judge_level
from vlnpe.scene_repair.write import scene as output

pytestmark = pytest.mark.chain

SOUND_LEVEL: dict[str, Any] = {
    "floor_area_m2": 60.0,
    "rays": {},
    "balls": {},
    "steps_over_15_mm": [],
    "steps_by_repair": 0,
    "holes_still_open": [],
    "holes_unlisted": [],
    "holes_left_without_reason": [],
}


@pytest.mark.parametrize(("cells", "fault"), [(12, False), (2568, True)])
def test_lost_cells_are_reported_with_size_place_and_advice(cells: int, fault: bool) -> None:
    area = cells * 0.0025
    place = {"xy_m": [1.5, -2.0], "area_m2": area}
    probes = {"walkable_cells_lost": cells, "walkable_places_lost": [place]}
    verdict = judge_level(SOUND_LEVEL, probes)
    assert bool(verdict.faults) == fault
    (text,) = verdict.faults + verdict.doubts
    for words in (f"{cells} walkable cells", f"{area:.3f} m²", "x 1.5, y -2.0", "after.png"):
        assert words in text


def test_a_single_ball_that_falls_through_is_a_fault() -> None:
    fallen = {"dropped": 600, "fell_through": 1, "where_xy_m": [[0.5, 0.5]]}
    assert judge_level({**SOUND_LEVEL, "balls": {"visual.npz": fallen}}, {}).faults
    assert not judge_level(SOUND_LEVEL, {}).faults


@pytest.fixture(scope="module")
def unsound(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A scan whose repair is made to fail its verification, and where it is repaired to."""
    folder = tmp_path_factory.mktemp("unsound")
    scan = scans.write_glb(scans.room(), folder / "room.glb")
    proof = {"sound": False, "problems": ["level 0: a fault"], "doubts": [], "levels": []}

    def run_here(out: Path, stage: str, item: WorkItem) -> Row:
        """Run an item in this process, in which the verification is replaced."""
        return Row(stage, item.name, item.key, "done", facts=item.job.run().facts)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(output, "verify_scene", lambda *_, **__: proof)
        patch.setattr(scenes, "run_single", run_here)
        assert run_repair(Repair(scan, folder / "scene")) == 1
        assert run_repair(Repair(scan, folder / "scene", allow_unsound=True)) == 0
    return scan, folder / "scene"


def test_the_scene_itself_records_it(unsound: tuple[Path, Path]) -> None:
    assert load_bundle(unsound[1]).source[UNSOUND] == ["level 0: a fault"]


def test_decisions_are_reported(unsound: tuple[Path, Path]) -> None:
    facts = facts_of(json.loads((unsound[1] / "repair.json").read_text()))
    text = "\n".join(scene_items.decisions(facts))
    for words in ("glTF is y up", "metres by its specification", "floor at 0.00 m", "20.0 m²"):
        assert words in text
    assert "UNSOUND level 0: a fault" in text
    assert facts["sound"] is False


def test_collect_refuses_unsound_scenes_unless_allowed(tmp_path: Path) -> None:
    rows = {
        name: Row("repair", name, f"key-{name}", "done", facts={"problems": problems})
        for name, problems in (("good", []), ("bad", ["level 1: cells lost", "more"]))
    }
    for name in rows:
        (tmp_path / "scenes" / name).mkdir(parents=True)
    ledger = Ledger(tmp_path)
    with Workers(1) as workers:
        context = Context(ledger, workers, progress=False)
        for allow, kept in ((False, {"good"}), (True, {"good", "bad"})):
            items = scene_items.check_items(rows, tmp_path / "scenes", allow)
            summary = run_stage(context, scene_items.CHECK_STAGE, items, required=True)
            assert set(summary.good()) == kept
            assert summary.quarantined == int(not allow)
    with pytest.raises(SceneError, match=r"bad is not sound: a; b.*--allow-unsound"):
        SoundnessJob("bad", ("a", "b"), allow_unsound=False).run()


def test_the_dataset_card_names_them() -> None:
    info = {
        "robot_type": "h1",
        "total_frames": 10,
        "total_episodes": 1,
        "total_tasks": 1,
        "fps": 4,
        "codebase_version": "v3.0",
        "features": {
            key: {"dtype": "video", "shape": [4, 4, 3], "info": {"video.depth_max": 20.0}}
            for key in (DEPTH_KEY, *usage.INPUTS, *usage.OUTPUTS)
        },
    }

    def card(source: dict[str, Any]) -> str:
        view = CameraFacts(CameraModel("ego", 4, 4, 90.0), (1.0, 1.0, 1.0), (0.0, 0.0, 0.0))
        splits = ({"train": [0]}, {"train": {"s"}})
        facts = CardFacts("t", "mit", *splits, 10.0, view, {"scenes": {"s": source}}, 1)
        return dataset_card(facts, info)

    assert "Unsound" not in card({"licence": "MIT"})
    assert "`s`: level 1: cells lost" in card({"licence": "MIT", UNSOUND: ["level 1: cells lost"]})
