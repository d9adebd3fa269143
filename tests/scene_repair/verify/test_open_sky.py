"""A building without ceilings is doubted, for depth is not measured where a ray meets nothing."""

import json
from pathlib import Path

import pytest

from tests.support.scenes import scans
from tests.support.scenes.repairs import repaired
from vlnpe.apartments import generate_exact
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.pipeline.stages.scenes.items import decisions
from vlnpe.pipeline.stages.scenes.outputs import facts_of

pytestmark = pytest.mark.chain


def share_and_doubts(bundle: SceneBundle) -> tuple[float, list[str]]:
    """Return the share that is recorded, and what is printed of it."""
    record = json.loads((bundle.root / "repair.json").read_text())
    printed = [line for line in decisions(facts_of(record)) if "--ceiling HEIGHT" in line]
    return record["levels"][0]["probes"]["open_sky_share"], printed


def test_a_generated_home_without_its_ceilings_is_doubted(tmp_path: Path) -> None:
    scan = generate_exact(0, tmp_path)  # with its ceilings: see tests/apartments/test_exact.py
    share, (doubt,) = share_and_doubts(repaired(scan, tmp_path, exclude=("Ceiling_*",)))
    assert share > 0.95
    assert doubt.startswith(f"doubt   level 0: {100 * share:.0f} % of the walkable floor has no")


def test_a_small_house_that_others_made_is_doubted(shared_scenes: Path, tmp_path: Path) -> None:
    share, doubts = share_and_doubts(repaired(shared_scenes / "small_house.glb", tmp_path))
    assert share > 0.9 and len(doubts) == 1


@pytest.mark.parametrize("open_m", [1.0, 3.0])
def test_what_is_open_is_counted(open_m: float, tmp_path: Path) -> None:
    """A skylight or a hole in a scanned ceiling is no missing ceiling; an open half is one."""
    skylight = scans.rectangle((0, 0), (open_m, 4))
    ceiling = scans.sheet((0, 0), (5, 4), z=2.6, step=0.5, without=skylight, facing_up=False)
    bundle = repaired([*scans.room(ceiling=False), ceiling], tmp_path)
    share, doubts = share_and_doubts(bundle)
    assert share == pytest.approx(open_m / 5.0, abs=0.05)
    assert bool(doubts) == (open_m > 2.5)
