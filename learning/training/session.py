"""One training from a recipe to a checkpoint: data, holdout, card."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ...datasets.episode_index import episode_tables
from ...datasets.instructions import InstructionChoice
from ...datasets.mixture.choice import Library, choose_all
from ...datasets.mixture.plan import MixturePlan, plan_mixture
from ...datasets.mixture.recipe import Recipe
from ...datasets.selection import Selection, select_all
from ...datasets.sequences import EpisodeSequences, SequenceConfig
from ...datasets.tokens import Tokens, training_tokens
from ...formats.core.atomic import file_digest, write_bytes
from ...formats.core.errors import InputError, check_name
from ...formats.core.rollout import DAGGER, EndReason
from ...formats.lerobot.layout import STATS_PATH
from ...formats.process.progress import progress_bar
from ...formats.process.source import code_digest
from ..camera import view_of
from ..card import SUFFIX, Card, View
from ..checkpoint import Checkpoint, load_checkpoint
from ..config import TrainConfig, train_config
from ..models.heads import FUTURE
from ..pretrained import FrozenEncoder, frozen_encoder
from .cache import CachedSequences, decode_all
from .curves import TrainingLog, Validation
from .holdout import Holdout, hold_out, published_holdout
from .train import Watcher, train_model

_DONE = "done"  # file of a finished training, with its checkpoint's digest
_SAMPLE = 32  # episodes of the training data, and of the held-out data, that curves are made of


@dataclass(frozen=True)
class Request:
    """Request for a training.

    Attributes:
        mixture: which of its mixtures; the only one when None.
        data: folder whose runs hold the datasets.
        out: folder of the checkpoint, the curves, the state and the decoded images.
        seed: seed of the training; the recipe's when None.
        changes: settings that override the recipe's `train`.
        start: checkpoint to start from (fine-tuning).
        validate: scores in closed loop at each checkpoint; without it the last one is kept.
        dagger: datasets of `vlnpe dagger`, whose walks get half of the draws however they ended.
        augmented: dataset of the expert's walks of more paths, drawn as often as those of the
            recipe; failures are left out.
        cache: folder of decoded images; `out`/cache when None.
        recipe_sha256: digest of the recipe's file.
        holdout: what to hold out; chosen from the mixture's own episodes when None.
    """

    recipe: Recipe
    data: Path
    out: Path
    mixture: str | None = None
    seed: int | None = None
    changes: Mapping[str, Any] | None = None
    start: Path | None = None
    validate: Validation | None = None
    dagger: tuple[Path, ...] = ()
    augmented: tuple[Path, ...] = ()
    cache: Path | None = None
    recipe_sha256: str = ""
    holdout: Holdout | None = None


@dataclass(frozen=True)
class Result:
    """Result of a training.

    Attributes:
        checkpoint: file of weights; its card lies beside it.
        curves: scores by step.
        chosen: step of the checkpoint.
    """

    checkpoint: Path
    curves: tuple[Mapping[str, Any], ...]
    chosen: int
    plan: MixturePlan


@dataclass(frozen=True)
class Planned:
    """Data of a training.

    Attributes:
        mixture: name of the recipe's mixture.
        held: held-out episodes by source.
        view: the camera of all episodes.
        start: what the training starts from.
        encoder: pretrained encoder of RGB, if the model has one.
    """

    config: TrainConfig
    mixture: str
    plan: MixturePlan
    holdout: Holdout
    held: Mapping[str, Selection]
    view: View
    start: Checkpoint | None
    encoder: FrozenEncoder | None = None

    def every(self, label: str) -> tuple[str, ...]:
        """Return the values of a label, such as `robot`, that occur among the episodes."""
        values = {str(v) for s in self.plan.sources for v in s.selection.labels(label)}
        return tuple(sorted(values))


def plan_training(request: Request) -> Planned:
    """Choose the episodes of a request, and open the model that it starts from.

    Raises:
        InputError: settings or data that are not valid.
        FileFormatError: damaged data or weights.
    """
    recipe = request.recipe
    config = train_config({**recipe.train, **(request.changes or {})})
    if (encoder := frozen_encoder(config.model)) is not None:
        config = replace(config, model=replace(config.model, encoder_width=encoder.width))
    start = load_checkpoint(request.start) if request.start else None
    if start is not None and start.card.config.model != config.model:
        raise InputError(f"{request.start}: its architecture differs from the recipe's `model`")
    name = _mixture_name(recipe, request.mixture)
    library = Library(request.data)
    used = choose_all(recipe, recipe.mixtures[name].weights, library)
    selections = {source: selection for source, (selection, _) in used.items()}
    holdout = request.holdout or _holdout(recipe, selections)
    plan = plan_mixture(recipe, name, library, "episodes", holdout.trajectories)
    held = {s: _held(selection, holdout) for s, selection in selections.items()}
    view = view_of([s.selection for s in plan.sources])
    planned = Planned(config, name, plan, holdout, held, view, start, encoder)
    if config.model.name == "rdp" and DAGGER in planned.every("controller"):
        raise InputError(
            f"mixture {name}: rdp learns motions, and those of {DAGGER} are a policy's; "
            "valid: cma, seq2seq, or sources of other controllers"
        )
    return planned


def training_key(planned: Planned, seed: int) -> str:
    """Return a digest of everything that the weights of a training depend on.

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
        "config": planned.config.to_json() | {"seeds": 0},
        "sources": [[s.name, s.share, episodes(s.selection)] for s in planned.plan.sources],
        "held": {name: episodes(selection) for name, selection in planned.held.items()},
        "seed": seed,
        "start": planned.start.sha256 if planned.start else "",
        "encoder": planned.encoder.facts if planned.encoder else {},
        "code": code_digest("learning.training.session"),
        "torch": torch.__version__,
    }
    return hashlib.blake2b(json.dumps(facts, sort_keys=True).encode(), digest_size=6).hexdigest()


def train_recipe(request: Request, planned: Planned | None = None, *, show: bool = True) -> Result:
    """Train one mixture of a recipe; the same request and folder again resumes.

    Args:
        request: what to train.
        planned: what `plan_training` returned of it, if that was called already.
        show: whether to show progress bars.

    Raises:
        InputError: settings or data that are not valid.
        FileFormatError: damaged data, weights or state.
    """
    recipe, out = request.recipe, request.out
    planned = planned or plan_training(request)
    config, plan = planned.config, planned.plan
    seed = recipe.seed if request.seed is None else request.seed
    start = planned.start
    tokens = start.card.tokens if start is not None else _vocabulary(plan, config)
    choice = InstructionChoice(config.instructions, seed)
    cache = request.cache or out / "cache"
    sources = [_cached(s.selection, tokens, planned, cache, choice) for s in plan.sources]
    seen = [_some(episodes, len(sources)) for episodes in sources]
    shares = plan.shares.tolist()
    more = []
    for name, selection in _more(request):
        walks = _cached(selection, tokens, planned, cache, choice)
        share = 0.5
        if name == "augmented":
            share = len(walks) / (len(walks) + sum(len(s) for s in sources))
        sources, shares = [*sources, walks], [*(s * (1 - share) for s in shares), share]
        more.append(_facts(name, share, selection))
    unseen = [_cached(s, tokens, planned, cache) for s in planned.held.values() if len(s)]
    unseen = [_some(episodes, len(unseen)) for episodes in unseen]
    decode_all([*sources, *unseen], show=show)
    card = Card(
        config=config,
        words=tokens.vocabulary.words,
        view=planned.view,
        robots=planned.every("robot"),
        controllers=planned.every("controller"),
        lights=planned.every("light"),
        seed=seed,
        recipe={"title": recipe.title, "mixture": planned.mixture, "sha256": request.recipe_sha256},
        data=(*(_facts(s.name, s.share, s.selection) for s in plan.sources), *more),
        held_out={
            "by": planned.holdout.by,
            "scenes": list(planned.holdout.scenes),
            "trajectories": sorted(planned.holdout.trajectories),
        },
        start=start.sha256 if start is not None else "",
        encoder=planned.encoder.facts if planned.encoder else {},
    )
    log = TrainingLog(out, card, config, seen, unseen, request.validate)
    with progress_bar("train", config.steps, show=show) as bar:
        train_model(
            sources,
            shares,
            tokens,
            config,
            seed=seed,
            state=out / "state.pt",
            watcher=Watcher(lambda done, loss: log.step(done, loss, bar), log.checkpoint),
            start=start.model.state_dict() if start is not None else None,
        )
    return Result(log.path, tuple(log.rows), log.chosen, plan)


def train_once(request: Request, planned: Planned, seed: int) -> Path:
    """Train into a folder below `request.out`, unless that was done; return the checkpoint.

    The folder is named by `training_key`: other data or settings are trained into another one.
    """
    name = planned.config.model.name
    folder = request.out / f"{name}-s{seed}-{training_key(planned, seed)}"
    checkpoint, done = folder / f"{name}{SUFFIX}", folder / _DONE
    if not (done.is_file() and checkpoint.is_file()):
        result = train_recipe(replace(request, out=folder, seed=seed), planned)
        (folder / "state.pt").unlink(missing_ok=True)
        write_bytes(done, f"{file_digest(result.checkpoint)}\n".encode())
    return checkpoint


def _more(request: Request) -> Iterator[tuple[str, Selection]]:
    """Yield the walks that were made for this training, by the name of their source."""
    if request.augmented:
        walks = select_all(request.augmented)
        yield "augmented", walks.take(walks.labels("end_reason") == str(EndReason.SUCCESS))
    if request.dagger:
        walks = select_all(request.dagger)
        # A robot that stood in an obstacle did nothing.
        yield "dagger", walks.take(walks.lengths > 1)


def _facts(name: str, share: float, selection: Selection) -> dict[str, Any]:
    """Return what a card says of a source."""
    return {
        "source": name,
        "share": round(share, 6),
        "episodes": len(selection),
        "sha": selection.digest,
        "datasets": sorted({selection.datasets[k].root.name for k in set(selection.dataset)}),
    }


def _mixture_name(recipe: Recipe, name: str | None) -> str:
    if name is None and len(recipe.mixtures) == 1:
        return next(iter(recipe.mixtures))
    if name is None:
        names = ", ".join(recipe.mixtures)
        raise InputError(f"the recipe has several mixtures: {names}; choose one with --mixture")
    check_name("mixture", name, recipe.mixtures)
    return name


def _holdout(recipe: Recipe, selections: Mapping[str, Selection]) -> Holdout:
    paths = [t for chosen in selections.values() for t in chosen.trajectories()]
    return hold_out(recipe, paths, published_holdout(selections.values()))


def _held(selection: Selection, holdout: Holdout) -> Selection:
    return selection.take(
        np.array([t in holdout.trajectories for t in selection.trajectories()], bool)
    )


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
    planned: Planned,
    cache: Path,
    choice: InstructionChoice | None = None,
) -> CachedSequences:
    config = planned.config
    how = SequenceConfig(config.size_px, config.max_steps, config.inflection, future=FUTURE)
    sequences = EpisodeSequences(selection, tokens, how, choice or InstructionChoice())
    return CachedSequences(sequences, cache, config.model.inputs, planned.encoder)


def _some(episodes: CachedSequences, sources: int) -> CachedSequences:
    """Return up to `_SAMPLE` episodes of all sources together, evenly spread."""
    chosen = episodes.sequences.selection
    count = min(max(_SAMPLE // sources, 1), len(chosen))
    mask = np.zeros(len(chosen), bool)
    mask[np.linspace(0, len(chosen) - 1, count).round().astype(int)] = True
    sequences = EpisodeSequences(
        chosen.take(mask), episodes.sequences.tokens, episodes.sequences.config
    )
    return CachedSequences(sequences, episodes.folder, episodes.images, episodes.encoder)
