"""`python -m benchmarks.scene_repair`: plant, repair, measure, and write README.md beside this."""

from __future__ import annotations

import logging
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from .cases import Case, apartment_case, house_cases, run_case
from .scenes import HEADSETS, SHARED, TUNING_SEEDS
from .tables import by_kind, missed, summary

log = logging.getLogger("benchmarks")
RUN = Path(__file__).resolve().parents[2] / "runs" / "bench_scene_repair"


@dataclass(frozen=True)
class Options:
    """What to run.

    Attributes:
        seeds: of built-in apartments.
        scenes: real scans: small_house, quest_….
        run: folder for scans and repaired scenes.
    """

    seeds: tuple[int, ...] = TUNING_SEEDS
    scenes: tuple[str, ...] = ("small_house", *HEADSETS)
    run: Path = RUN


def main(options: Options) -> int:
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    log.setLevel(logging.INFO)
    cases = [apartment_case(seed, "apartments") for seed in options.seeds]
    if SHARED.is_dir():
        for scene in options.scenes:
            more = scene in HEADSETS
            cases += [Case("real scans", scene, 0)] if more else house_cases("real scans")
    scores = []
    for case in cases:
        out = options.run / f"{case.scene} {case.seed}".replace(" ", "-")
        result, seconds = run_case(case, options.run / "scans", out)
        scores.append(result)
        log.info("%s, repaired in %.1f s", case.scene, seconds)
        log.info("%s\n", "\n".join(missed([result])))
    log.info("%s", "\n".join([*summary(scores), "", *by_kind(scores), "", *missed(scores)]))
    return 0


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Options)))
