"""One case: a scene with planted holes, repaired and scored."""

from __future__ import annotations

import shutil
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vlnpe.scene_repair.config import RepairConfig
from vlnpe.scene_repair.repair import repair_scene

from .decoys import DECOYS
from .fillers import compare
from .plant import plant
from .scenes import HEADSETS, HOUSE, SHARED, Source, apartment, headset, house, write_planted
from .score import score
from .store import Result, load, path_of, repair_code, save

HOLES, HOUSE_ROUNDS = 24, 3
# Pictures are drawn small: nobody looks at hundreds of them.
CONFIG = RepairConfig(picture_px=400)


@dataclass(frozen=True)
class Case:
    """What to plant where.

    Attributes:
        group: the section of the report it belongs to.
        scene: a headset's scan, the house, or `apartment <seed>`.
        seed: of the planting.
        decoys: names from `DECOYS`.
    """

    group: str
    scene: str
    seed: int
    decoys: tuple[str, ...] = ()

    @property
    def folder(self) -> str:
        """Name of its folder."""
        return f"{self.scene} {self.seed}".replace(" ", "-")


def apartment_case(seed: int, group: str) -> Case:
    """Holes and two decoys in an apartment; which ones, its seed decides."""
    names = tuple(DECOYS)
    pairs = [(a, b) for a in names for b in names if a < b]
    return Case(group, f"apartment {seed}", seed, pairs[seed % len(pairs)])


def real_cases(group: str) -> list[Case]:
    """The house, planted several times, and the headsets' rooms; none if they are not here."""
    if not SHARED.is_dir():
        return []
    rounds = [Case(group, HOUSE, k, tuple(DECOYS)) for k in range(HOUSE_ROUNDS)]
    return rounds + [Case(group, name, 0) for name in HEADSETS]


def open_source(scene: str, cache: Path) -> Source:
    """The scan of a case."""
    if scene.startswith("apartment "):
        return apartment(int(scene.split()[1]), cache)
    return house() if scene == HOUSE else headset(scene)


def run_case(case: Case, with_fillers: bool, run: Path, keep: bool = False) -> Result:
    """Plant, repair and measure, unless that was done with the same code.

    Args:
        case: what.
        with_fillers: let other fillers work on the same scan, too.
        run: folder for scans, planted scans, repaired scenes and results.
        keep: take a result of older repair code for good.
    """
    path = path_of(run, case, HOLES)
    known = load(path)
    enough = known is not None and (known.fillers or not with_fillers)
    if known is not None and enough and (keep or known.code == repair_code()):
        return known
    code = repair_code()
    source = open_source(case.scene, run / "scans")
    planted = plant(source.site, np.random.default_rng(case.seed), HOLES, case.decoys)
    out = run / case.folder
    shutil.rmtree(out, ignore_errors=True)
    (out / "bundle").mkdir(parents=True)
    scan = write_planted(planted, source, out)
    started = time.process_time()
    bundle = repair_scene(scan, out / "bundle", CONFIG, lambda _: None)
    seconds = time.process_time() - started
    others = compare(planted, scan, out) if with_fillers else []
    result = Result(code, score(planted, bundle), seconds, others)
    save(path, result)
    return result
