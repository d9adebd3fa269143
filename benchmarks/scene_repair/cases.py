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
from .plant import plant
from .scenes import HOUSE, Source, apartment, headset, house, write_planted
from .score import Score, score

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


def apartment_case(seed: int, group: str) -> Case:
    """Holes and two decoys in an apartment; which ones, its seed decides."""
    names = tuple(DECOYS)
    pairs = [(a, b) for a in names for b in names if a < b]
    return Case(group, f"apartment {seed}", seed, pairs[seed % len(pairs)])


def house_cases(group: str) -> list[Case]:
    """The house, planted several times."""
    return [Case(group, HOUSE, k, tuple(DECOYS)) for k in range(HOUSE_ROUNDS)]


def open_source(scene: str, cache: Path) -> Source:
    """The scan of a case."""
    if scene.startswith("apartment "):
        return apartment(int(scene.split()[1]), cache)
    return house() if scene == HOUSE else headset(scene)


def run_case(case: Case, cache: Path, out: Path, holes: int = HOLES) -> tuple[Score, float]:
    """Plant, repair, measure; and the seconds that the repair took.

    Args:
        case: what.
        cache: where scans of built-in apartments are kept.
        out: a folder for the planted scan and the repaired scene; emptied first.
        holes: how many to plant.
    """
    source = open_source(case.scene, cache)
    planted = plant(source.site, np.random.default_rng(case.seed), holes, case.decoys)
    shutil.rmtree(out, ignore_errors=True)
    (out / "bundle").mkdir(parents=True)
    scan = write_planted(planted, source, out)
    started = time.perf_counter()
    bundle = repair_scene(scan, out / "bundle", CONFIG, lambda _: None)
    seconds = time.perf_counter() - started
    return score(planted, bundle), seconds
