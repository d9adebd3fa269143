"""`python -m benchmarks.scene_repair --complete`: plant, repair, measure, write README.md here.

Without `--complete` it runs what is asked for and prints. Results are kept under
`runs/bench_scene_repair` and taken again while the code is the same.
"""

import logging
import multiprocessing
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import tyro

from . import report, speed, walk
from .cases import Case, Result, apartment_case, real_cases, run_case, stored_rows
from .scenes import HELD_OUT_SEEDS, TUNING_SEEDS

log = logging.getLogger("benchmarks")
HERE = Path(__file__).resolve().parent
RUN = HERE.parents[1] / "runs" / "bench_scene_repair"
WALK_SEEDS = tuple(range(12))


@dataclass(frozen=True)
class Options:
    """Selection of cases.

    Attributes:
        seeds: of built-in apartments.
        held_out: how many of the seeds reserved for the final check; none while tuning.
        scenes: real scans by name, `all` or none.
        speed: measure time and memory again, which takes minutes on an idle core.
        walks: number of holes to walk over again.
        complete: everything, 40 apartments among it, and write README.md: half an hour or more.
        quick: two apartments and the real scans, nothing else.
        keep: accept results of older repair code.
        workers: processes.
        run: folder for scans, scenes and results.
        write: write README.md and its picture, whatever was run.
    """

    seeds: tuple[int, ...] = TUNING_SEEDS
    held_out: int = 0
    scenes: tuple[str, ...] = ("all",)
    speed: bool = False
    walks: int = 0
    complete: bool = False
    quick: bool = False
    keep: bool = False
    workers: int = 1
    run: Path = RUN
    write: bool = False


def main(options: Options) -> int:
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    log.setLevel(logging.INFO)
    options.run.mkdir(parents=True, exist_ok=True)
    if options.complete:
        held_out = len(HELD_OUT_SEEDS)
        options = replace(options, held_out=held_out, speed=True, walks=50, write=True)
    text = "\n".join(sections(options))
    if options.write:
        (HERE / "README.md").write_text(text)
    log.info("%s", text)
    return 0


def sections(options: Options) -> list[str]:
    """Return the report's lines."""
    seeds = options.seeds[:2] if options.quick else options.seeds
    held_out = HELD_OUT_SEEDS[: options.held_out]
    groups = {
        report.TUNING: [apartment_case(seed, report.TUNING) for seed in seeds],
        report.HELD_OUT: [apartment_case(seed, report.HELD_OUT) for seed in held_out],
        report.REAL: [
            case
            for case in real_cases(report.REAL)
            if "all" in options.scenes or case.scene in options.scenes
        ],
    }
    cases = [case for group in groups.values() for case in group]
    done = dict(zip(cases, _results(cases, options), strict=True))
    lines = [report.INTRODUCTION.format(machine=_machine())]
    for title, members in groups.items():
        lines += report.group_section(title, [(case, done[case]) for case in members])
    scans, folder = options.run / "scans", options.run
    measured = speed.measure(scans, folder) if options.speed else None
    runs = stored_rows(folder, "speed", speed.Run, measured)
    lines += report.speed_section(runs, HERE if options.write else folder)
    walked = walk.walks(WALK_SEEDS, scans, folder, options.walks) if options.walks else None
    walks = stored_rows(folder, "walk", walk.Walk, walked)
    return lines + report.walk_section(walks)


def _results(cases: list[Case], options: Options) -> list[Result]:
    work = partial(run_case, run=options.run, keep=options.keep)
    if options.workers == 1:
        return [_logged(case, work(case)) for case in cases]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.workers, mp_context=context) as pool:
        results = pool.map(work, cases)
        return [_logged(case, result) for case, result in zip(cases, results, strict=True)]


def _logged(case: Case, result: Result) -> Result:
    log.info("%s, repaired in %.1f CPU seconds", case.folder, result.seconds)
    return result


def _machine() -> str:
    load = os.getloadavg()[0]
    return f"On {os.cpu_count()} cores, load {load:.1f} at the end of repairing."


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Options)))
