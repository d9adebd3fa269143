"""What a training is to learn from: the episodes of a recipe's mixture, and those held out."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ...datasets.episode_index import episode_tables
from ...datasets.mixture.choice import Library, choose_all
from ...datasets.mixture.plan import MixturePlan, plan_mixture
from ...datasets.mixture.recipe import Recipe
from ...datasets.selection import Selection
from ...formats.core.atomic import file_digest
from ...formats.core.errors import InputError, check_name
from ...formats.core.rollout import DAGGER
from ...formats.lerobot.layout import STATS_PATH
from ...formats.process.source import code_digest
from ..camera import view_of
from ..card import View
from ..checkpoint import Checkpoint, load_checkpoint
from ..config import TrainConfig, train_config
from ..language import TextEncoder, language_of, text_encoder
from ..pretrained import FrozenEncoder, encoder_of, frozen_encoder
from .curves import Validation
from .holdout import Holdout, hold_out, published_holdout


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
class Planned:
    """Data of a training.

    Attributes:
        mixture: name of the recipe's mixture.
        held: held-out episodes by source.
        view: the camera of all episodes.
        start: what the training starts from.
        encoder, language: pretrained encoders of RGB and of instructions, if the model has them.
    """

    config: TrainConfig
    mixture: str
    plan: MixturePlan
    holdout: Holdout
    held: Mapping[str, Selection]
    view: View
    start: Checkpoint | None
    encoder: FrozenEncoder | None = None
    language: TextEncoder | None = None

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
    if (language := text_encoder(config.model)) is not None:
        config = replace(config, model=replace(config.model, language_width=language.width))
    start = load_checkpoint(request.start) if request.start else None
    if start is not None:
        if start.card.config.model != config.model:
            raise InputError(f"{request.start}: its architecture differs from the recipe's `model`")
        encoder_of(start.card)
        language_of(start.card)
    name = _mixture_name(recipe, request.mixture)
    library = Library(request.data)
    used = choose_all(recipe, recipe.mixtures[name].weights, library)
    selections = {source: selection for source, (selection, _) in used.items()}
    holdout = request.holdout or _holdout(recipe, selections)
    plan = plan_mixture(recipe, name, library, "episodes", holdout.trajectories)
    held = {s: _held(selection, holdout) for s, selection in selections.items()}
    view = view_of([s.selection for s in plan.sources])
    planned = Planned(config, name, plan, holdout, held, view, start, encoder, language)
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
        "language": planned.language.facts if planned.language else {},
        "code": code_digest("learning.training.session"),
        "torch": torch.__version__,
    }
    return hashlib.blake2b(json.dumps(facts, sort_keys=True).encode(), digest_size=6).hexdigest()


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
