"""`vlnpe benchmark`: policies x robots x controllers on the same episodes."""

import contextlib
import io
import platform
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ....collectors.controllers import CONTROLLERS, valid_controllers
from ....collectors.replay.suits import check_suits
from ....collectors.robots import get_robot
from ....evaluation.policies.registry import resolve_policy
from ....evaluation.results import COLUMNS, cell_text, interval_of
from ....evaluation.rounds import spread
from ....formats.core.atomic import atomic_file, write_json
from ....formats.core.episode import Episode
from ....formats.core.errors import InputError, check_name, did_you_mean
from ....formats.process.source import code_digest
from ....formats.vlnce.files import read_episodes, write_episodes
from ...collect import command as collect
from ...collect.evaluation import evaluate_policy
from ...context import open_context
from ...engine.ledger import MANIFEST_NAME
from ...inputs.benchmark_sets import SETS, BenchmarkSet, episodes_digest, paths_digest
from ...inputs.crews import chosen_robots, listed_names
from ...options.collect import Collect
from ...options.evaluate import Benchmark, Evaluate
from ...provenance import versions
from ...stages.evaluation.job import EvaluateJob
from ...summary import print_result

FOLDER, RESULT_NAME, PAGE_NAME = "benchmark", "benchmark.json", "benchmark.md"


@dataclass(frozen=True)
class Cell:
    """One evaluation of the table."""

    policy: str
    robot: str
    controller: str

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"{Path(self.policy).stem}-{self.robot}-{self.controller}".replace(":", "-")


def run(options: Benchmark) -> int:
    """Evaluate every cell and write the table; return the exit code."""
    cells = _cells(options)
    published = SETS.get(str(options.episodes))
    if options.out and not published:
        raise InputError(
            f"--out {options.out}: results of a run go to its own {FOLDER}/; valid: "
            f"with {' or '.join(SETS)} alone"
        )
    folder = options.out or Path("runs") / options.episodes if published else options.episodes
    if published:
        _prepare(published, folder, options)
    splits = _splits(options, published, folder)
    chosen = folder / FOLDER / "asked"
    for left in chosen.glob("*.json.gz"):  # splits that an earlier call asked for
        left.unlink()
    evaluated: dict[str, list[Episode]] = {}
    for split, episodes in splits.items():
        evaluated[split] = list(spread(episodes, options.limit or len(episodes)))
        write_episodes(chosen / f"{split}.json.gz", evaluated[split])
    for robot in dict.fromkeys(cell.robot for cell in cells):  # before any cell walks
        for episodes in evaluated.values():
            check_suits(get_robot(robot), episodes)
    code, results = 0, {}
    value: dict[str, Any] = {}
    for cell in cells:
        results[cell] = _evaluate(cell, options, folder, chosen)
        code |= len(results[cell]["quarantined"]) > options.max_failed
        value = _value(options, published, evaluated, splits, results)
        # After each cell, so that an interrupted run keeps what it measured.
        write_json(folder / FOLDER / RESULT_NAME, value)
        with atomic_file(folder / FOLDER / PAGE_NAME) as temporary:
            temporary.write_text(_page(value))
    if (folder / MANIFEST_NAME).is_file():
        with open_context(folder, options) as context:
            outputs = (chosen, folder / FOLDER / RESULT_NAME, folder / FOLDER / PAGE_NAME)
            context.ledger.record(outputs)
    out = {"out": str(folder)}
    text = f"\n{_page(value)}\nresults: {folder / FOLDER / RESULT_NAME}"
    print_result(options, value | out, text)
    return int(code)


def _cells(options: Benchmark) -> list[Cell]:
    policies = listed_names("--policy", options.policy)
    controllers = listed_names("--controller", options.controller)
    for policy in policies:
        resolve_policy(policy)
    discrete = [name for name, entry in CONTROLLERS.items() if entry.discrete]
    for controller in controllers:
        check_name("controller of a benchmark", controller, discrete)
    return [
        Cell(policy, robot.name, controller)
        for controller in controllers
        for robot in chosen_robots(options.robot)
        if controller in valid_controllers(robot)
        for policy in policies
    ]


def _prepare(published: BenchmarkSet, folder: Path, options: Benchmark) -> None:
    """Make scenes and episodes, unless they are there."""
    settings = Collect(
        scene=published.scene,
        splits=",".join(f"{split}={count}" for split, count in published.splits.items()),
        train_scenes=str(published.train_scenes),
        robot_radius_m=published.robot_radius_m,
        robot="h1",
        count=1,
        seed=published.seed,
        only_episodes=True,
        out=folder,
        json=True,
        **vars(options.execution()),
    )
    with contextlib.redirect_stdout(io.StringIO()):
        collect.run(settings)


def _splits(
    options: Benchmark, published: BenchmarkSet | None, folder: Path
) -> dict[str, list[Episode]]:
    files = sorted((folder / "episodes").glob("*.json.gz"))
    if not files:
        raise InputError(
            f"{folder}{did_you_mean(str(folder), SETS)}: contains no episodes/*.json.gz; valid: a "
            f"run folder, or {', '.join(SETS)}"
        )
    by_split: dict[str, list[Episode]] = {}
    for file in files:
        for episode in read_episodes(file):
            by_split.setdefault(episode.split, []).append(episode)
    split_names = (
        listed_names("--split", options.split, by_split)
        if options.split
        else published.test_splits
        if published
        else by_split
    )
    for split in split_names:
        check_name("split", split, by_split)
    return {split: by_split[split] for split in split_names}


def _evaluate(cell: Cell, options: Benchmark, folder: Path, chosen: Path) -> dict[str, Any]:
    settings = Evaluate(
        episodes=chosen,
        scenes=folder / "scenes",
        policy=cell.policy,
        robot=cell.robot,
        controller=cell.controller,
        camera=options.camera,
        seed=options.seed,
        out=folder / FOLDER / cell.name,
        **vars(options.execution()),
    )
    return evaluate_policy(settings).results


def _value(
    options: Benchmark,
    published: BenchmarkSet | None,
    evaluated: dict[str, list[Episode]],
    splits: dict[str, list[Episode]],
    results: dict[Cell, dict[str, Any]],
) -> dict[str, Any]:
    """Return the result file's content."""
    digests = {split: episodes_digest(episodes) for split, episodes in splits.items()}
    paths = {split: paths_digest(episodes) for split, episodes in splits.items()}
    expected = dict(published.paths_sha256) if published else {}
    return {
        "format": "vlnpe-benchmark/1",
        "benchmark": str(options.episodes) if published else options.episodes.name,
        **versions(code_digest(EvaluateJob.__module__)),
        "machine": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "seed": options.seed,
        "episodes_sha256": digests,
        "paths_sha256": paths,
        "as_published": {
            split: paths[split] == expected[split] for split in paths if split in expected
        },
        "episodes": {split: len(episodes) for split, episodes in evaluated.items()},
        "of": {split: len(episodes) for split, episodes in splits.items()},
        "cells": [
            {
                **vars(cell),
                "count": len(result["episodes"]),
                "quarantined": len(result["quarantined"]),
                "setting": result["setting"],
                "summary": result["summary"],
            }
            for cell, result in results.items()
        ],
    }


def _page(value: dict[str, Any]) -> str:
    """Return the table as Markdown: means with 95 % intervals."""
    counts = ", ".join(
        f"{count} of {value['of'][split]} {split}" for split, count in value["episodes"].items()
    )
    lines = [
        f"{value['benchmark']}: {counts} episodes; code {value['code_sha256'][:12]}, lock "
        f"{(value['lock_sha256'] or 'none')[:12]}",
        *(
            f"**Other paths than published**: {split} has digest "
            f"{value['paths_sha256'][split][:12]}"
            for split, same in value["as_published"].items()
            if not same
        ),
        "",
        "| controller | robot | policy | episodes | "
        + " | ".join(f"{name} [{unit}]" for name, (unit, _) in COLUMNS.items() if name != "time")
        + " |",
        "| --- | --- | --- | ---: |" + " ---: |" * (len(COLUMNS) - 1),
    ]
    for cell in value["cells"]:
        means = {name: interval_of(cell["summary"][name]) for name in COLUMNS if name != "time"}
        shown = [cell_text(name, mean) for name, mean in means.items()]
        count = str(cell["count"])
        if cell["quarantined"]:
            count += f" ({cell['quarantined']} without a result)"
        row = [cell["controller"], cell["robot"], Path(cell["policy"]).stem, count, *shown]
        lines.append(f"| {' | '.join(row)} |")
    return "\n".join(lines) + "\n"
