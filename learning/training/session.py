"""One training from a recipe to a checkpoint: data, curves, selection, card."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...datasets.instructions import InstructionChoice
from ...datasets.mixture.plan import Library, MixturePlan, choose, plan_mixture
from ...datasets.mixture.recipe import Recipe
from ...datasets.selection import Selection
from ...datasets.sequences import EpisodeSequences, SequenceConfig
from ...datasets.tokens import Tokens, training_tokens
from ...formats.core.atomic import write_bytes
from ...formats.core.errors import FileFormatError, InputError, UnknownNameError
from ...formats.core.progress import progress_bar
from ..camera import view_of
from ..card import SUFFIX, Card
from ..checkpoint import load_checkpoint, save_checkpoint
from ..config import TrainConfig, train_config
from ..models.heads import FUTURE
from ..models.registry import Model
from .cache import CachedSequences
from .corrections import CorrectedEpisodes
from .holdout import Holdout, hold_out, published_holdout
from .scores import step_scores
from .train import TrainingEpisodes, Watcher, train_model

CURVES = "curves.csv"
_SAMPLE = 32  # episodes of the training data, and of the held-out data, that curves are made of

# Returns scores of a model in closed loop; checkpoints are chosen by the score `SR`.
Validation = Callable[[Model, Card], Mapping[str, float]]


@dataclass(frozen=True)
class Request:
    """What to train.

    Attributes:
        recipe: sources, mixtures and settings.
        mixture: which of its mixtures; the only one when None.
        data: folder whose runs hold the datasets.
        out: folder of the checkpoint, the curves, the state and the decoded images.
        seed: of the training; the recipe's when None.
        changes: settings that override the recipe's `train`.
        start: checkpoint to start from (fine-tuning).
        validate: scores in closed loop at each checkpoint; without it the last one is kept.
        corrections: walks of `corrections.write_correction`, which get half of the draws (DAgger).
        cache: folder of decoded images; `out`/cache when None.
        recipe_sha256: digest of the recipe's file.
    """

    recipe: Recipe
    data: Path
    out: Path
    mixture: str | None = None
    seed: int | None = None
    changes: Mapping[str, Any] | None = None
    start: Path | None = None
    validate: Validation | None = None
    corrections: tuple[Path, ...] = ()
    cache: Path | None = None
    recipe_sha256: str = ""


@dataclass(frozen=True)
class Result:
    """What a training made.

    Attributes:
        checkpoint: file of weights; its card lies beside it.
        curves: scores by step.
        chosen: step of the checkpoint.
        plan: the training data.
    """

    checkpoint: Path
    curves: tuple[Mapping[str, Any], ...]
    chosen: int
    plan: MixturePlan


def train_recipe(request: Request, *, show: bool = True) -> Result:
    """Train one mixture of a recipe; the same request and folder again resumes.

    Raises:
        InputError: settings or data that are not valid.
        FileFormatError: damaged data, weights or state.
    """
    recipe, out = request.recipe, request.out
    config = train_config({**recipe.train, **(request.changes or {})})
    name = _mixture_name(recipe, request.mixture)
    library = Library(request.data)
    found = {s: choose(recipe.sources[s], s, library)[0] for s in recipe.mixtures[name].weights}
    holdout = _holdout(recipe, found)
    plan = plan_mixture(recipe, name, library, "episodes", holdout.trajectories)
    held = {s: _held(selection, holdout) for s, selection in found.items()}
    seed = recipe.seed if request.seed is None else request.seed
    start = load_checkpoint(request.start) if request.start else None
    if start is not None and start.card.config.model != config.model:
        raise InputError(f"{request.start}: has another architecture than the recipe's `model`")
    tokens = start.card.tokens if start is not None else _vocabulary(plan, config)
    choice = InstructionChoice(config.instructions, seed)
    cache = request.cache or out / "cache"
    sources = [_cached(s.selection, tokens, config, cache, choice) for s in plan.sources]
    seen = [_some(episodes, len(sources)) for episodes in sources]
    unseen = [_cached(s, tokens, config, cache) for s in held.values() if len(s)]
    unseen = [_some(episodes, len(unseen)) for episodes in unseen]
    _decode([*sources, *unseen], show)
    card = Card(
        config=config,
        words=tokens.vocabulary.words,
        view=view_of([s.selection for s in plan.sources]),
        robots=_every(plan, "robot"),
        controllers=_every(plan, "controller"),
        lights=_every(plan, "light"),
        seed=seed,
        recipe={"title": recipe.title, "mixture": name, "sha256": request.recipe_sha256},
        data=tuple(
            {
                "source": s.name,
                "share": round(s.share, 6),
                "episodes": len(s.selection),
                "sha": s.selection.digest,
                "datasets": sorted({row.root.name for row in s.rows if row.episodes}),
            }
            for s in plan.sources
        ),
        held_out={
            "by": holdout.by,
            "scenes": list(holdout.scenes),
            "trajectories": sorted(holdout.trajectories),
        },
        start=start.sha256 if start is not None else "",
    )
    episodes: list[TrainingEpisodes] = [*sources]
    shares = plan.shares.tolist()
    if request.corrections:
        corrected = CorrectedEpisodes(request.corrections, tokens, config)
        episodes, shares = [*episodes, corrected], [*(share / 2 for share in shares), 0.5]
        source = {"source": "corrections", "share": 0.5, "episodes": len(corrected)}
        card = replace(card, data=(*card.data, source | {"sha": corrected.digest, "datasets": []}))
    log = _Log(request, card, config, seen, unseen)
    with progress_bar("train", config.steps, show=show) as bar:
        train_model(
            episodes,
            shares,
            tokens,
            config,
            seed=seed,
            state=out / "state.pt",
            watcher=Watcher(lambda done, loss: log.step(done, loss, bar), log.checkpoint),
            start=start.model.state_dict() if start is not None else None,
        )
    return Result(log.path, tuple(log.rows), log.chosen, plan)


class _Log:
    """Keeps the curves and the chosen checkpoint of one training."""

    def __init__(
        self,
        request: Request,
        card: Card,
        config: TrainConfig,
        seen: list[CachedSequences],
        unseen: list[CachedSequences],
    ):
        self.rows: list[dict[str, Any]] = []
        self.path = request.out / f"{config.model.name}{SUFFIX}"
        self.chosen = 0
        self._request, self._card, self._config = request, card, config
        self._seen, self._unseen = seen, unseen
        self._losses: list[float] = []
        self._curves = request.out / CURVES

    def step(self, done: int, loss: float | None, bar: Any) -> None:
        if loss is None:  # resumed: what was logged up to there holds
            self.rows = [row for row in _read_curves(self._curves) if row["step"] <= done]
            self.chosen = self._best()
        else:
            self._losses.append(loss)
            recent = self._losses[-20:]
            bar.set_postfix_str(f"loss {sum(recent) / len(recent):.3f}")
        bar.update(done - bar.n)

    def checkpoint(self, model: Model, done: int) -> None:
        model.eval()
        row: dict[str, Any] = {"step": done, "loss": sum(self._losses) / len(self._losses)}
        row |= {f"train {k}": v for k, v in step_scores(model, self._seen, self._config).items()}
        row |= {f"held {k}": v for k, v in step_scores(model, self._unseen, self._config).items()}
        if self._request.validate is not None:
            row |= self._request.validate(model, self._card)
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


def _mixture_name(recipe: Recipe, name: str | None) -> str:
    if name is None and len(recipe.mixtures) == 1:
        return next(iter(recipe.mixtures))
    if name is None:
        names = ", ".join(recipe.mixtures)
        raise InputError(f"the recipe has several mixtures: {names}; choose one with --mixture")
    if name not in recipe.mixtures:
        raise UnknownNameError("mixture", name, recipe.mixtures)
    return name


def _holdout(recipe: Recipe, found: Mapping[str, Selection]) -> Holdout:
    paths = [t for chosen in found.values() for t in chosen.trajectories()]
    return hold_out(recipe, paths, published_holdout(found.values()))


def _held(found: Selection, holdout: Holdout) -> Selection:
    return found.take(np.array([t in holdout.trajectories for t in found.trajectories()], bool))


def _vocabulary(plan: MixturePlan, config: TrainConfig) -> Tokens:
    limit = 1 if config.instructions == "own" else None
    words = [
        text
        for source in plan.sources
        for texts in source.selection.labels("instructions")
        for text in texts[:limit]
    ]
    return training_tokens(words, config.tokens)


def _cached(
    selection: Selection,
    tokens: Tokens,
    config: TrainConfig,
    cache: Path,
    choice: InstructionChoice | None = None,
) -> CachedSequences:
    how = SequenceConfig(config.size_px, config.max_steps, config.inflection, future=FUTURE)
    sequences = EpisodeSequences(selection, tokens, how, choice or InstructionChoice())
    return CachedSequences(sequences, cache, config.model.inputs)


def _some(episodes: CachedSequences, sources: int) -> CachedSequences:
    """Return up to `_SAMPLE` episodes of all sources together, evenly spread."""
    chosen = episodes.sequences.selection
    count = min(max(_SAMPLE // sources, 1), len(chosen))
    mask = np.zeros(len(chosen), bool)
    mask[np.linspace(0, len(chosen) - 1, count).round().astype(int)] = True
    sequences = EpisodeSequences(
        chosen.take(mask), episodes.sequences.tokens, episodes.sequences.config
    )
    return CachedSequences(sequences, episodes.folder, episodes.images)


def _decode(episodes: list[CachedSequences], show: bool) -> None:
    """Decode all episodes that will be needed, each once."""
    with progress_bar("decode", sum(map(len, episodes)), show=show) as bar:
        for some in episodes:
            for number in range(len(some)):
                some.prepare(number)
                bar.update()


def _every(plan: MixturePlan, label: str) -> tuple[str, ...]:
    return tuple(sorted({str(v) for s in plan.sources for v in s.selection.labels(label)}))


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
        raise FileFormatError(path, f"not the curves of a training ({error})") from error
