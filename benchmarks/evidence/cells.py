"""Train and evaluate the cells of the tables, each once, with the product's own commands."""

import contextlib
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from benchmarks.evidence.records import Row, Training
from vlnpe.datasets.mixture.recipe import read_recipe
from vlnpe.datasets.mixture.shipped import recipe_path
from vlnpe.evaluation.results import RESULTS_NAME, read_results
from vlnpe.evaluation.rounds import spread
from vlnpe.formats.core.atomic import atomic_file, file_digest
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.errors import InputError, VlnpeError
from vlnpe.formats.untrusted.yaml_document import read_yaml
from vlnpe.formats.vlnce.files import read_episodes, write_episodes
from vlnpe.learning.config import DISCRETE
from vlnpe.pipeline.cli import main as vlnpe

SETTINGS = Path(__file__).with_name("settings.yaml")
_KEYS = {"recipe", "dagger", "seeds", "episodes"}


@dataclass(frozen=True)
class Settings:
    """What all rows have in common.

    Attributes:
        train: the recipe's settings.
        dagger_rounds, dagger_episodes: of every training of discrete actions.
        seeds: of the trainings.
        episodes: to test on, at most.
    """

    train: Mapping[str, Any]
    dagger_rounds: int
    dagger_episodes: int
    seeds: tuple[int, ...]
    episodes: int


@dataclass(frozen=True)
class Bench:
    """Data, scenes and outputs.

    Attributes:
        data: folder whose runs hold the training datasets.
        run: run folder with the unseen episodes and their scenes.
        split: of those episodes.
        out: folder of trainings and evaluations.
        settings: of trainings and tests.
        scenes: names of the training scenes, the first ones being those of smaller amounts.
        workers: of the evaluations.
        call: runs a command of `vlnpe`, as `pipeline.cli.main`.
    """

    data: Path
    run: Path
    split: str
    out: Path
    settings: Settings
    scenes: tuple[str, ...] = ()
    workers: int = 0
    call: Callable[[Sequence[str]], int] = vlnpe


class CellError(VlnpeError):
    """A training or an evaluation of a cell failed."""


def read_settings(path: Path = SETTINGS) -> Settings:
    """Read the settings of all rows.

    Raises:
        FileFormatError: The file, or its recipe, is not readable as YAML.
        InputError: A key is missing or unknown, or there is no such recipe.
    """
    value = read_yaml(path)
    if not isinstance(value, dict) or set(value) != _KEYS:
        found = sorted(value) if isinstance(value, dict) else value
        raise InputError(f"{path}: keys {found}; valid: {', '.join(sorted(_KEYS))}")
    dagger = value["dagger"]
    return Settings(
        read_recipe(recipe_path(str(value["recipe"]))).train,
        int(dagger["rounds"]),
        int(dagger["episodes"]),
        tuple(value["seeds"]),
        int(value["episodes"]),
    )


def training_scenes(data: Path) -> tuple[str, ...]:
    """Return the scenes of the training episodes of all runs in `data`, in their files' order.

    Raises:
        InputError: there is no such run.
    """
    files = sorted(data.glob("**/episodes/train.json.gz"))
    if not files:
        raise InputError(f"{data}: no run with episodes/train.json.gz; collect one first")
    episodes = [episode for file in files for episode in read_episodes(file)]
    return tuple(dict.fromkeys(episode.scene_id for episode in episodes))


def results_of(bench: Bench, row: Row, seed: int) -> Path:
    """Return where the results of a cell lie, or will lie."""
    return bench.out / "evaluations" / row.cell(seed) / RESULTS_NAME


def missing(bench: Bench, row: Row) -> str:
    """Return why a row cannot be measured with the data at hand; empty if it can."""
    if not isinstance(row.policy, Training):
        return ""
    scenes = chosen_scenes(bench, row.policy)
    if row.policy.only and not scenes:
        return f"no training scene is called {row.policy.only}…"
    if row.policy.scenes > len(scenes):
        return f"the data has {len(scenes)} training scenes"
    for walks in row.policy.robots:
        if not _datasets(bench, walks):
            return no_data(walks)
    return ""


def chosen_scenes(bench: Bench, training: Training) -> tuple[str, ...]:
    """Return the training scenes of a row."""
    named = tuple(name for name in bench.scenes if name.startswith(training.only))
    return named[: training.scenes] if training.scenes else named


def no_data(walks: str) -> str:
    """Return what is said of a row whose walks, as `robot/controller`, are not at hand."""
    return f"no data of {walks}"


def _datasets(bench: Bench, walks: str) -> list[Path]:
    """Return the datasets of a robot's walks, as `robot/controller`."""
    return sorted(
        info.parents[1]
        for info in bench.data.glob(f"**/lerobot/{walks.replace('/', '-')}-*/meta/info.json")
    )


def measure(bench: Bench, row: Row, seed: int) -> Path:
    """Train and evaluate one cell unless that is done; return its results file.

    Raises:
        CellError: A command failed; it said why.
    """
    results = results_of(bench, row, seed)
    if results.is_file():
        return results
    policy = row.policy
    if isinstance(policy, Training):
        policy = str(train(bench, policy, seed))
    asked = _asked(bench)
    test = row.test
    call = ["evaluate", str(asked), "--scenes", str(bench.run / "scenes"), "--policy", policy]
    call += ["--robot", test.robot, "--controller", test.controller, "--light", test.light]
    for flag, value in (
        ("--camera-height", test.camera_height_m),
        ("--camera-pitch", test.camera_pitch_deg),
    ):
        if value is not None:
            call += [flag, f"{value:g}"]
    call += ["--seed", str(seed), "--workers", str(bench.workers), "--out", str(results.parent)]
    _call(bench, call)
    read_results(results)
    return results


def train(bench: Bench, training: Training, seed: int) -> Path:
    """Train one seed unless that is done; return its checkpoint.

    Raises:
        CellError: The training failed; it said why.
    """
    settings, out = bench.settings, bench.out / "trainings" / f"{training.name}-s{seed}"
    rounds = settings.dagger_rounds if training.model in DISCRETE else 0
    last = out / f"dagger-{rounds}" if rounds else out
    checkpoint, done = last / f"{training.model}.safetensors", out / "done"
    if done.is_file():
        return checkpoint
    path = bench.out / "recipes" / f"{training.name}.yaml"
    with atomic_file(path) as temporary:
        temporary.write_text(yaml.safe_dump(recipe(bench, training), sort_keys=False))
    call = ["train", str(path), "--data", str(bench.data), "--out", str(out), "--seed", str(seed)]
    call += ["--cache", str(bench.out / "cache"), "--threads", "1"]
    if rounds:
        run = _run_of(bench, training)
        call += ["--dagger", str(rounds), "--dagger-episodes", str(settings.dagger_episodes)]
        robot, controller = training.robots[0].split("/")
        call += ["--run", str(run), "--robot", robot, "--controller", controller]
    _call(bench, call)
    with atomic_file(done) as temporary:
        temporary.write_text(file_digest(checkpoint) + "\n")
    return checkpoint


def recipe(bench: Bench, training: Training) -> dict[str, Any]:
    """Return the recipe of a training, as its YAML has it."""
    train: dict[str, Any] = dict(bench.settings.train)
    train["model"] = {
        **train.get("model", {}),
        "name": training.model,
        "inputs": list(training.inputs),
    }
    if training.model not in DISCRETE:  # as many steps as the others with their rounds
        train["steps"] *= 1 + bench.settings.dagger_rounds
    train["steps"] *= training.longer * (len(training.robots) if training.passes else 1)
    chosen = chosen_scenes(bench, training) if training.scenes or training.only else ()
    sources = {}
    for walks in training.robots:
        robot, controller = walks.split("/")
        source: dict[str, Any] = {
            "robots": [robot],
            "controllers": [controller],
            "lights": ["baked"],
        }
        if chosen:
            source["scenes"] = list(chosen)
        if training.fraction < 1.0:
            source["fraction"] = training.fraction
        sources[robot] = source
    return {
        "recipe": 1,
        "title": training.name,
        "holdout": "split",  # val_seen and val_unseen are left out of the training
        "sources": sources,
        "mixtures": {training.name: list(sources)},
        "train": train,
    }


def asked(bench: Bench) -> list[Episode]:
    """Return the episodes that every row is tested on."""
    found = read_episodes(bench.run / "episodes" / f"{bench.split}.json.gz")
    return list(spread(found, bench.settings.episodes))


def _asked(bench: Bench) -> Path:
    path = bench.out / "asked" / f"{bench.split}.json.gz"
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_episodes(path, asked(bench))
    return path


def _run_of(bench: Bench, training: Training) -> Path:
    """Return the run folder whose training episodes DAgger walks."""
    found = _datasets(bench, training.robots[0])
    if not found:
        raise CellError(f"{bench.data}: {no_data(training.robots[0])}")
    return found[0].parents[1]


def _call(bench: Bench, arguments: Sequence[str]) -> None:
    with contextlib.redirect_stdout(io.StringIO()):
        code = bench.call(list(arguments))
    if code:
        raise CellError(f"`vlnpe {' '.join(arguments)}` ended with exit code {code}")
