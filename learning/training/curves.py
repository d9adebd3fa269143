"""Curves of a training, and the checkpoint that is chosen by them."""

import csv
import io
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...formats.core.atomic import write_bytes
from ...formats.core.errors import FileFormatError
from ..card import SUFFIX, Card
from ..checkpoint import save_checkpoint
from ..config import TrainConfig
from ..models.registry import Model
from .cache import CachedSequences
from .scores import step_scores

CURVES = "curves.csv"

# Returns scores of a model in closed loop; checkpoints are chosen by the score `SR`.
Validation = Callable[[Model, Card], Mapping[str, float]]


class TrainingLog:
    """Keeps the curves and the chosen checkpoint of one training.

    Attributes:
        rows: scores by step.
        path: file of the chosen weights.
        chosen: step of that checkpoint.
    """

    def __init__(
        self,
        out: Path,
        card: Card,
        config: TrainConfig,
        seen: list[CachedSequences],
        unseen: list[CachedSequences],
        validate: Validation | None = None,
    ):
        """Begin without rows.

        Args:
            out: folder of the curves and the weights.
            card: card of the weights, except for the number of steps and the curves.
            seen: episodes of the training data to score.
            unseen: held-out episodes to score.
            validate: scores in closed loop at each checkpoint; without it the last one is kept.
        """
        self.rows: list[dict[str, Any]] = []
        self.path = out / f"{config.model.name}{SUFFIX}"
        self.chosen = 0
        self._card, self._config, self._validate = card, config, validate
        self._seen, self._unseen = seen, unseen
        self._losses: list[float] = []
        self._curves = out / CURVES

    def step(self, done: int, loss: float | None, bar: Any) -> None:
        """Take the loss of a step; None for those that an interrupted training made."""
        if loss is None:  # resumed: what was logged up to there holds
            self.rows = [row for row in _read_curves(self._curves) if row["step"] <= done]
            self.chosen = self._best()
        else:
            self._losses.append(loss)
            recent = self._losses[-20:]
            bar.set_postfix_str(f"loss {sum(recent) / len(recent):.3f}")
        bar.update(done - bar.n)

    def checkpoint(self, model: Model, done: int) -> None:
        """Score a model, and write its weights if they are the best so far."""
        model.eval()
        row: dict[str, Any] = {"step": done, "loss": sum(self._losses) / len(self._losses)}
        row |= {f"train {k}": v for k, v in step_scores(model, self._seen, self._config).items()}
        row |= {f"held {k}": v for k, v in step_scores(model, self._unseen, self._config).items()}
        if self._validate is not None:
            row |= self._validate(model, self._card)
        model.train()
        self._losses.clear()
        finite = {k: round(float(v), 6) for k, v in row.items() if np.isfinite(v)}
        self.rows = [*self.rows, finite | {"step": done}]
        _write_curves(self._curves, self.rows)
        self.chosen = self._best()
        if self.chosen == done:
            self._card = replace(self._card, steps=done)
            save_checkpoint(self.path, model, replace(self._card, curves=tuple(self.rows)))

    def _best(self) -> int:
        """Return the last of the steps with the highest SR; without validation, the last one."""
        best = max((row.get("SR", 0.0) for row in self.rows), default=0.0)
        steps = [row["step"] for row in self.rows if row.get("SR", 0.0) == best]
        return int(steps[-1]) if steps else 0


def _write_curves(path: Path, rows: list[dict[str, Any]]) -> None:
    names = list(dict.fromkeys(key for row in rows for key in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_bytes(path, text.getvalue().encode())


def _read_curves(path: Path) -> list[dict[str, Any]]:
    if not path.is_file():
        return []
    try:
        rows = list(csv.DictReader(io.StringIO(path.read_text())))
        values = [{k: float(v) for k, v in row.items() if v} for row in rows]
        return [row | {"step": int(row["step"])} for row in values]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FileFormatError(path, f"not the curves of a training run ({error})") from error
