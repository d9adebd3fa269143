"""One training from a recipe to a checkpoint, its curves and its card."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...datasets.instructions import InstructionChoice
from ...datasets.mixture.plan import MixturePlan
from ...datasets.selection import Selection, select_all
from ...datasets.sequences import EpisodeSequences, SequenceConfig
from ...datasets.tokens import Tokens, training_tokens
from ...formats.core.atomic import file_digest, write_bytes
from ...formats.core.rollout import EndReason
from ...formats.process.progress import progress_bar
from ..card import SUFFIX, Card
from ..config import TrainConfig
from ..models.heads import FUTURE
from .cache import CachedSequences, decode_all
from .curves import TrainingLog
from .plan import Planned, Request, plan_training, training_key
from .train import Watcher, train_model

_DONE = "done"  # file of a finished training, with its checkpoint's digest
_SAMPLE = 32  # episodes of the training data, and of the held-out data, that curves are made of


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
    chosen = [s.selection for s in plan.sources]
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
        chosen.append(selection)
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
        stairs=_stairs(chosen, start.card if start is not None else None),
        scenes=_scenes(chosen, start.card if start is not None else None),
        encoder=planned.encoder.facts if planned.encoder else {},
        language=planned.language.facts if planned.language else {},
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


def training_folder(request: Request, planned: Planned, seed: int) -> Path:
    """Return the folder of a training below `request.out`.

    It is named by `training_key`: other data or settings are trained into another one.
    """
    return request.out / f"{planned.config.model.name}-s{seed}-{training_key(planned, seed)}"


def checkpoint_of(request: Request, planned: Planned, seed: int) -> Path | None:
    """Return the checkpoint in its `training_folder`, None if the training is not done."""
    folder = training_folder(request, planned, seed)
    checkpoint = folder / f"{planned.config.model.name}{SUFFIX}"
    return checkpoint if (folder / _DONE).is_file() and checkpoint.is_file() else None


def train_once(request: Request, planned: Planned, seed: int) -> Path:
    """Train into its `training_folder`, unless that was done; return the checkpoint."""
    done, folder = checkpoint_of(request, planned, seed), training_folder(request, planned, seed)
    if done is not None:
        return done
    result = train_recipe(replace(request, out=folder, seed=seed), planned)
    (folder / "state.pt").unlink(missing_ok=True)
    write_bytes(folder / _DONE, f"{file_digest(result.checkpoint)}\n".encode())
    return result.checkpoint


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


def _stairs(selections: Sequence[Selection], start: Card | None) -> bool | None:
    """Return whether a walk takes stairs, or one of the start did; None where that is unknown."""
    taken = [paths for selection in selections for paths in selection.labels("staircases")]
    known = [None if paths is None else bool(paths) for paths in taken]
    known += [] if start is None else [start.stairs]
    return True if True in known else None if None in known else False


def _scenes(selections: Sequence[Selection], start: Card | None) -> tuple[str, ...]:
    """Return the scenes of the walks, and those of the start."""
    seen = {str(scene) for selection in selections for scene in selection.labels("scene_id")}
    return tuple(sorted(seen.union(start.scenes if start is not None else ())))


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
    """Return decoded episodes; with a `choice`, those of the training, which may be mirrored."""
    config = planned.config
    how = SequenceConfig(config.size_px, config.max_steps, config.inflection, future=FUTURE)
    sequences = EpisodeSequences(selection, tokens, how, choice or InstructionChoice())
    read, mirror = config.model.inputs, config.mirror and choice is not None
    return CachedSequences(sequences, cache, read, planned.encoder, planned.language, mirror=mirror)


def _some(episodes: CachedSequences, sources: int) -> CachedSequences:
    """Return up to `_SAMPLE` episodes of all sources together, evenly spread."""
    chosen = episodes.sequences.selection
    count = min(max(_SAMPLE // sources, 1), len(chosen))
    mask = np.zeros(len(chosen), bool)
    mask[np.linspace(0, len(chosen) - 1, count).round().astype(int)] = True
    sequences = EpisodeSequences(
        chosen.take(mask), episodes.sequences.tokens, episodes.sequences.config
    )
    return CachedSequences(
        sequences, episodes.folder, episodes.images, episodes.encoder, episodes.language
    )
