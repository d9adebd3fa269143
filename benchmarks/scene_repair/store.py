"""Results on disk, so that a long run can go on where it was stopped."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vlnpe.formats.core.atomic import write_json
from vlnpe.formats.core.source import source_digest
from vlnpe.pipeline.engine.keys import digest

from .fillers import FillerScore
from .plant import PlantedHole
from .score import HoleScore, Score
from .shapes import Outline

# Of a hole's height errors so many are kept, evenly chosen.
KEPT_ERRORS = 300


@dataclass(frozen=True)
class Result:
    """One case's outcome.

    Attributes:
        code: version of the code that repaired.
        score: what was measured.
        seconds: CPU time of the repair.
        fillers: what others made of it.
    """

    code: str
    score: Score
    seconds: float
    fillers: list[FillerScore]


def repair_code() -> str:
    """Version of the code under test."""
    return source_digest("scene_repair.repair")


def path_of(run: Path, *identity: Any) -> Path:
    """Where a case's result lies; the benchmark's own code is part of what it is."""
    own = [p.read_text() for p in sorted(Path(__file__).parent.glob("*.py")) if p.stem in _MEASURE]
    return run / "results" / f"{digest(list(identity), own)[:16]}.json"


_MEASURE = {"cut", "decoys", "plant", "scenes", "score", "shapes", "site", "vertical", "fillers"}


def save(path: Path, result: Result) -> None:
    """Write a result."""
    path.parent.mkdir(parents=True, exist_ok=True)
    score = {**asdict(result.score), "natural_errors_m": _thinned(result.score.natural_errors_m)}
    score["holes"] = [_hole(h) for h in result.score.holes]
    fillers = [{**asdict(f), "holes": [_hole(h) for h in f.holes]} for f in result.fillers]
    write_json(
        path,
        {
            "code": result.code,
            "seconds": result.seconds,
            "score": score,
            "fillers": fillers,
        },
    )


def load(path: Path) -> Result | None:
    """Read a result; None if there is none."""
    if not path.is_file():
        return None
    data = json.loads(path.read_text())
    score = data["score"]
    score["holes"] = [_hole_of(h) for h in score["holes"]]
    score["natural_errors_m"] = np.array(score["natural_errors_m"])
    fillers = [
        FillerScore(**{**f, "holes": [_hole_of(h) for h in f["holes"]]}) for f in data["fillers"]
    ]
    return Result(data["code"], Score(**score), data["seconds"], fillers)


def kept_rows[Row](run: Path, name: str, kind: type[Row], rows: list[Row] | None) -> list[Row]:
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
