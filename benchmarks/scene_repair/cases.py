"""One case: a scene with planted holes, repaired and scored."""

import json
import shutil
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vlnpe.formats.core.atomic import write_json
from vlnpe.formats.process.source import source_digest
from vlnpe.pipeline.engine.work import digest
from vlnpe.scene_repair.config import RepairConfig
from vlnpe.scene_repair.repair import repair_scene

from .planting.decoys import DECOYS
from .planting.plant import PlantedHole, plant
from .planting.shapes import Outline
from .scenes import HEADSETS, HOUSE, SHARED, Source, apartment, headset, house, write_planted
from .score import HoleScore, Score, score

HOLES, HOUSE_ROUNDS = 24, 3
# Pictures are drawn small, since there are hundreds.
CONFIG = RepairConfig(picture_px=400)
# Number of height errors kept per hole, evenly chosen.
KEPT_ERRORS = 300
_MEASURE = {"cut", "decoys", "plant", "scenes", "score", "shapes", "site", "vertical"}


@dataclass(frozen=True)
class Case:
    """A scene and the holes to plant in it.

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
    """Return the holes and two decoys in an apartment; which ones, its seed decides."""
    names = tuple(DECOYS)
    pairs = [(a, b) for a in names for b in names if a < b]
    return Case(group, f"apartment {seed}", seed, pairs[seed % len(pairs)])


def real_cases(group: str) -> list[Case]:
    """Return the house, planted several times, and the headsets' rooms.

    None if they are not here.
    """
    if not SHARED.is_dir():
        return []
    rounds = [Case(group, HOUSE, k, tuple(DECOYS)) for k in range(HOUSE_ROUNDS)]
    return rounds + [Case(group, name, 0) for name in HEADSETS]


def open_source(scene: str, cache: Path) -> Source:
    """Return the scan of a case."""
    if scene.startswith("apartment "):
        return apartment(int(scene.split()[1]), cache)
    return house() if scene == HOUSE else headset(scene)


def run_case(case: Case, run: Path, keep: bool = False) -> "Result":
    """Plant, repair and measure, unless that was done with the same code.

    Args:
        case: what.
        run: folder for scans, planted scans, repaired scenes and results.
        keep: accept a result of older repair code.
    """
    path = path_of(run, case, HOLES)
    earlier, code = load(path), repair_code()
    if earlier is not None and (keep or earlier.code == code):
        return earlier
    source = open_source(case.scene, run / "scans")
    planted = plant(source.site, np.random.default_rng(case.seed), HOLES, case.decoys)
    out = run / case.folder
    shutil.rmtree(out, ignore_errors=True)
    (out / "bundle").mkdir(parents=True)
    scan = write_planted(planted, source, out)
    started = time.process_time()
    bundle = repair_scene(scan, out / "bundle", CONFIG, lambda _: None)
    seconds = time.process_time() - started
    result = Result(code, score(planted, bundle), seconds)
    save(path, result)
    return result


@dataclass(frozen=True)
class Result:
    """One case's outcome.

    Attributes:
        code: version of the code that repaired.
        score: what was measured.
        seconds: CPU time of the repair.
    """

    code: str
    score: Score
    seconds: float


def repair_code() -> str:
    """Return the version of the code under test."""
    return source_digest("scene_repair.repair")


def path_of(run: Path, *identity: Any) -> Path:
    """Return where a case's result lies; the benchmark's own code is part of what it is."""
    own = [p.read_text() for p in sorted(Path(__file__).parent.glob("*.py")) if p.stem in _MEASURE]
    return run / "results" / f"{digest(list(identity), own)[:16]}.json"


def save(path: Path, result: Result) -> None:
    """Write a result."""
    path.parent.mkdir(parents=True, exist_ok=True)
    score = {**asdict(result.score), "natural_errors_m": _thinned(result.score.natural_errors_m)}
    score["holes"] = [_hole(h) for h in result.score.holes]
    write_json(path, {"code": result.code, "seconds": result.seconds, "score": score})


def load(path: Path) -> Result | None:
    """Read a result; None if there is none."""
    if not path.is_file():
        return None
    data = json.loads(path.read_text())
    score = data["score"]
    score["holes"] = [_hole_of(h) for h in score["holes"]]
    score["natural_errors_m"] = np.array(score["natural_errors_m"])
    return Result(data["code"], Score(**score), data["seconds"])


def stored_rows[Row](run: Path, name: str, kind: type[Row], rows: list[Row] | None) -> list[Row]:
    """Write rows (flat dataclasses) of a table, or read those of an earlier run if None."""
    path = run / "results" / f"{name}.json"
    if rows is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_json(path, [vars(row) for row in rows])
        return rows
    return [kind(**row) for row in json.loads(path.read_text())] if path.is_file() else []


def _hole(score: HoleScore) -> dict[str, Any]:
    hole = score.hole
    return {
        **asdict(score),
        "errors_m": _thinned(score.errors_m),
        "hole": {
            **asdict(hole),
            "outline": [ring.round(5).tolist() for ring in hole.outline.rings],
        },
    }


def _hole_of(data: dict[str, Any]) -> HoleScore:
    rings = [np.array(ring) for ring in data["hole"]["outline"]]
    hole = PlantedHole(**{**data["hole"], "outline": Outline(rings)})
    return HoleScore(**{**data, "hole": hole, "errors_m": np.array(data["errors_m"])})


def _thinned(errors: np.ndarray) -> list[float]:
    step = max(1, len(errors) // KEPT_ERRORS)
    return errors[::step].round(6).tolist()
