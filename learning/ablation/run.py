"""Run an ablation from recipe to scores; finished trainings are reused."""

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ...datasets.episode_index import episode_tables
from ...datasets.mixture.choice import Library, choose_all
from ...datasets.mixture.plan import MixturePlan, plan_mixture
from ...datasets.mixture.recipe import NO_HOLDOUT, Recipe
from ...datasets.selection import Selection
from ...datasets.sequences import EpisodeSequences, SequenceConfig
from ...datasets.tokens import Tokens, training_tokens
from ...formats.core.atomic import file_digest, write_json
from ...formats.core.errors import InputError, check_name
from ...formats.core.progress import progress_bar
from ...formats.core.source import code_digest
from ...formats.lerobot.layout import STATS_PATH
from ..config import DISCRETE, TrainConfig, train_config
from ..models.heads import FUTURE
from ..training.cache import CachedSequences, decode_all
from ..training.holdout import Holdout, hold_out, published_holdout
from ..training.train import Watcher, train_model
from .evaluate import EpisodeScore, score_constant, score_model, score_repeat

_TRAINING_SAMPLE = 16  # training episodes that are predicted, too: does the agent fit them?


@dataclass(frozen=True)
class Row:
    """One mixture's trainings.

    Attributes:
        plan: the training data.
        scores: by evaluated source, by seed.
        training: scores of some training episodes, by seed.
        training_constant: scores of the commonest action of each source on the same episodes.
    """

    plan: MixturePlan
    scores: Mapping[str, list[list[EpisodeScore]]]
    training: list[list[EpisodeScore]]
    training_constant: list[EpisodeScore]


@dataclass(frozen=True)
class Ablation:
    """All results of an ablation.

    Attributes:
        holdout: what was held out of every training.
        held: held-out episodes by evaluated source.
        rows: by mixture.
        constant, repeat: scores without training, by evaluated source.
    """

    recipe: Recipe
    config: TrainConfig
    holdout: Holdout
    held: Mapping[str, Selection]
    rows: Mapping[str, Row]
    constant: Mapping[str, list[EpisodeScore]]
    repeat: Mapping[str, list[EpisodeScore]]


@dataclass(frozen=True)
class Job:
    """One training and its files."""

    seed: int
    checkpoint: Path
    result: Path


def run_ablation(
    recipe: Recipe, data: Path, out: Path, changes: Mapping[str, Any], show: bool = True
) -> Ablation:
    """Train every mixture with every seed and predict the held-out episodes.

    Args:
        data: folder whose runs hold the datasets.
        out: cache, checkpoints and results; given again, the run resumes where it stopped.
        changes: settings that override the recipe's.

    Raises:
        InputError: settings or data that are not valid.
    """
    config = train_config({**recipe.train, **changes})
    check_name("model of an ablation", config.model.name, DISCRETE)
    if recipe.holdout == NO_HOLDOUT:
        raise InputError("holdout none: an ablation predicts held-out episodes; valid: any other")
    library = Library(data)
    evaluated = recipe.evaluate or tuple(recipe.sources)
    used = {n for m in recipe.mixtures.values() for n in m.weights} | set(evaluated)
    every = choose_all(recipe, sorted(used), library)
    found = {name: selection for name, (selection, _) in every.items()}
    paths = [t for chosen in found.values() for t in chosen.trajectories()]
    holdout = hold_out(recipe, paths, published_holdout(found.values()))
    held = {name: _held_out(name, found[name], holdout) for name in evaluated}
    plans = {
        name: plan_mixture(recipe, name, library, "episodes", holdout.trajectories)
        for name in recipe.mixtures
    }
    trained = [source.selection for plan in plans.values() for source in plan.sources]
    blank = training_tokens([], config.tokens)
    baselines = {name: _cached(chosen, blank, config, out) for name, chosen in held.items()}
    training = [_cached(chosen, blank, config, out) for chosen in trained]
    decode_all([*training, *baselines.values()], show=show)
    rows = {}
    with progress_bar("train", len(plans) * config.seeds * config.steps, show=show) as bar:
        for name, plan in plans.items():
            rows[name] = _row(plan, held, config, recipe.seed, out, bar)
    return Ablation(
        recipe,
        config,
        holdout,
        held,
        rows,
        {name: score_constant(episodes) for name, episodes in baselines.items()},
        {name: score_repeat(episodes) for name, episodes in baselines.items()},
    )


def _held_out(name: str, found: Selection, holdout: Holdout) -> Selection:
    chosen = found.take(np.array([t in holdout.trajectories for t in found.trajectories()], bool))
    if not len(chosen):
        raise InputError(
            f"source {name!r} has no episode of the held-out {holdout.by}s; collect more, or give "
            "another holdout_fraction or seed"
        )
    return chosen


def _cached(
    selection: Selection, tokens: Tokens, config: TrainConfig, out: Path
) -> CachedSequences:
    how = SequenceConfig(config.size_px, config.max_steps, future=FUTURE)
    return CachedSequences(EpisodeSequences(selection, tokens, how), out / "cache")


def _row(
    plan: MixturePlan,
    held: Mapping[str, Selection],
    config: TrainConfig,
    first_seed: int,
    out: Path,
    bar: Any,
) -> Row:
    words = [
        instructions[0]
        for source in plan.sources
        for instructions in source.selection.labels("instructions")
    ]
    tokens = training_tokens(words, config.tokens)
    sources = [_cached(source.selection, tokens, config, out) for source in plan.sources]
    tests = {name: _cached(selection, tokens, config, out) for name, selection in held.items()}
    some = [_some(source, len(sources)) for source in sources]
    scores: dict[str, list[list[EpisodeScore]]] = {name: [] for name in held}
    training = []
    for seed in range(first_seed, first_seed + config.seeds):
        job = training_job(plan, held, config, seed, out)
        before = bar.n
        if not job.result.is_file():
            bar.set_postfix_str(f"{plan.name}, seed {seed}")
            model = train_model(
                sources,
                plan.shares.tolist(),
                tokens,
                config,
                seed=seed,
                state=job.checkpoint,
                watcher=Watcher(partial(_show, bar, before)),
            )
            value = {name: score_model(model, test) for name, test in tests.items()}
            seen = [score for episodes in some for score in score_model(model, episodes)]
            written = {name: [s.to_json() for s in run] for name, run in value.items()}
            write_json(job.result, {"scores": written, "training": [s.to_json() for s in seen]})
            job.checkpoint.unlink()
        bar.update(before + config.steps - bar.n)
        value = json.loads(job.result.read_text())
        for name, run in value["scores"].items():
            scores[name].append([EpisodeScore(**score) for score in run])
        training.append([EpisodeScore(**score) for score in value["training"]])
    constant = [score for episodes in some for score in score_constant(episodes)]
    return Row(plan, scores, training, constant)


def _show(bar: Any, before: int, done: int, _loss: float | None) -> None:
    bar.update(before + done - bar.n)


def _some(source: CachedSequences, sources: int) -> CachedSequences:
    """Return some of a source's training episodes."""
    selection = source.sequences.selection
    few = np.arange(len(selection)) < max(_TRAINING_SAMPLE // sources, 1)
    sequences = EpisodeSequences(
        selection.take(few), source.sequences.tokens, source.sequences.config
    )
    return CachedSequences(sequences, source.folder)


def training_job(
    plan: MixturePlan, held: Mapping[str, Selection], config: TrainConfig, seed: int, out: Path
) -> Job:
    """Return a training whose file names hash everything that its result depends on.

    Frames are identified by their statistics, episodes by their names, labels and instructions.
    """

    def episodes(selection: Selection) -> list[Any]:
        files = [
            file_digest(path)
            for index in selection.datasets
            for path in (index.root / STATS_PATH, *episode_tables(index.root))
        ]
        return [selection.digest, selection.row.tolist(), files]

    facts = {
        "config": config.to_json() | {"seeds": 0, "checkpoint_every": 0},
        "sources": [[s.name, s.share, episodes(s.selection)] for s in plan.sources],
        "held": {name: episodes(selection) for name, selection in held.items()},
        "seed": seed,
        "code": code_digest("learning.training.train", "learning.ablation.evaluate"),
        "torch": torch.__version__,
    }
    digest = hashlib.blake2b(json.dumps(facts, sort_keys=True).encode(), digest_size=6).hexdigest()
    slug = re.sub(r"[^a-z0-9]+", "-", plan.name.lower()).strip("-")
    stem = out / "rows" / f"{slug}-seed{seed}-{digest}"
    return Job(seed, stem.with_suffix(".pt"), stem.with_suffix(".json"))
