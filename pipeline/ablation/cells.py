"""The cells of an ablation: trainings of a row with a seed, and the walks of a policy in a test.

A cell that is finished is not done again, and one that was interrupted goes on where it stopped.
"""

import math
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...datasets.mixture.comparison import METRICS
from ...evaluation.results import COLUMNS, by_uid, uid_of
from ...formats.vlnce.files import write_episodes
from ...learning.card import read_card
from ...learning.training.session import checkpoint_of, train_once, training_folder
from ..collect.evaluation import evaluate_policy
from ..engine.lock import lock
from ..options.training import Ablate
from .plan import Ablation, evaluation

TRAININGS, WALKS, EPISODES = "trainings", "walks", "episodes"  # folders


@dataclass(frozen=True)
class CellResult:
    """Metrics of the walks of one policy in one test.

    Attributes:
        values: (N, metrics) by episode, rounded to 0.01; None where a walk has no result.
        failed: why walks have no result, by episode.
        gait_sha256: digest of the gait that the robot walked with, if it has one.
        checkpoint_sha256: digest of the weights, of a trained policy.
        curve: scores of the training by step.
    """

    values: list[list[float | None]]
    failed: Mapping[str, str]
    gait_sha256: str | None
    checkpoint_sha256: str | None
    curve: list[dict[str, float]]


def measure(
    ablation: Ablation, options: Ablate
) -> Iterator[tuple[tuple[str, str, int], CellResult]]:
    """Train and walk; yield the result of each row, test and seed.

    Seeds come last, so that an interrupted run has whole tables of fewer seeds.
    """
    folder = _write_episodes(ablation, options.out)
    rows = {n: r for n, r in ablation.comparison.rows.items() if n not in ablation.missing}
    cells = [
        (name, seed)
        for seed in ablation.seeds
        for name, row in rows.items()
        if row.varies or seed == ablation.seeds[0]
    ]
    for number, (name, seed) in enumerate(cells, start=1):
        sys.stderr.write(f"[{number}/{len(cells)}] {name}, seed {seed}\n")
        policy, checkpoint = rows[name].policy, None
        label = f"{policy}-s{seed}"
        if name in ablation.trainings:
            checkpoint = train(ablation, name, seed, options.trainings or options.out)
            policy, label = str(checkpoint), checkpoint.parent.name
        for test in ablation.comparison.tests_of(name):
            out = options.out / WALKS / _slug(f"{label}--{test}")
            evaluated = evaluate_policy(
                evaluation(
                    ablation.comparison,
                    test,
                    policy,
                    episodes=folder,
                    scenes=ablation.scenes,
                    seed=seed,
                    workers=options.workers,
                    out=out,
                )
            )
            yield (name, test, seed), _result(ablation, evaluated.results, checkpoint)


def train(ablation: Ablation, row: str, seed: int, out: Path) -> Path:
    """Train a row with a seed unless that is done; return its checkpoint.

    Rows that are trained in the same way share their trainings, and so may other ablations: one
    that is under way is waited for.
    """
    training = ablation.trainings[row]
    request = replace(training.request, out=out / TRAININGS)
    folder = training_folder(request, training.planned, seed)
    done = checkpoint_of(request, training.planned, seed)
    if done is not None:
        return done
    folder.mkdir(parents=True, exist_ok=True)
    with lock(folder, wait=True):
        return train_once(request, training.planned, seed)


def _write_episodes(ablation: Ablation, out: Path) -> Path:
    """Write the episodes that all policies walk, one file per split, and return their folder."""
    folder = out / EPISODES
    splits: dict[str, list[Any]] = {}
    for episode in ablation.episodes:
        splits.setdefault(episode.split, []).append(episode)
    for file in folder.glob("*.json.gz"):
        if file.name.removesuffix(".json.gz") not in splits:
            file.unlink()
    for split, episodes in splits.items():
        write_episodes(folder / f"{split}.json.gz", episodes)
    return folder


def _result(ablation: Ablation, results: Mapping[str, Any], checkpoint: Path | None) -> CellResult:
    walks = by_uid(results["episodes"])
    values = [
        [_rounded(COLUMNS[metric][1](walks[uid])) if uid in walks else None for metric in METRICS]
        for uid in (uid_of(e.split, e.scene_id, e.episode_id) for e in ablation.episodes)
    ]
    digest, curve = None, []
    if checkpoint is not None:
        card, digest = read_card(checkpoint)
        curve = [{k: round(float(v), 4) for k, v in point.items()} for point in card.curves]
    gait = results["setting"]["gait_sha256"]
    return CellResult(values, results["quarantined"], gait, digest, curve)


def _rounded(value: float) -> float | None:
    return round(value, 2) if math.isfinite(value) else None


def _slug(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9.]+", "-", text).strip("-")
