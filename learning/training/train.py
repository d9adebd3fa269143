"""Train a model on a mixture; an interrupted training resumes from its last state."""

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from pickle import UnpicklingError
from typing import Any

import torch
from torch import Tensor

from ...datasets.mixture.loader import MixtureLoader
from ...datasets.mixture.sampler import MixtureSampler
from ...datasets.sequences import collate_sequences
from ...datasets.tokens import Tokens
from ...formats.core.atomic import atomic_file
from ...formats.core.errors import FileFormatError
from ...formats.process.threads import made_ahead
from ..config import TrainConfig
from ..models.registry import Model, build_model
from .cache import CachedSequences
from .losses import training_loss

_UNKNOWN = 1  # the vocabulary's index of unknown words
_MAX_GRADIENT = 5.0
# What reading a file raises that is no state of this training.
_DAMAGED = (OSError, RuntimeError, KeyError, ValueError, TypeError, EOFError, UnpicklingError)


def chosen_device(config: TrainConfig) -> torch.device:
    """Return the device of the configuration."""
    if config.device == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    return torch.device(config.device)


@dataclass(frozen=True)
class Watcher:
    """Callbacks of a training.

    Attributes:
        step: called after each step with the number of steps done and the loss; None for the steps
            that an earlier, interrupted run made.
        checkpoint: called whenever the training's state is about to be written, with the model and
            the number of steps done.
        waited: called before each step with the seconds for which it waited for its batch.
    """

    step: Callable[[int, float | None], None] = lambda done, loss: None
    checkpoint: Callable[[Model, int], None] = lambda model, done: None
    waited: Callable[[float], None] = lambda seconds: None


def train_model(
    sources: Sequence[CachedSequences],
    shares: list[float],
    tokens: Tokens,
    config: TrainConfig,
    *,
    seed: int,
    state: Path,
    watcher: Watcher = Watcher(),
    start: Mapping[str, Tensor] | None = None,
) -> Model:
    """Train for `config.steps` steps.

    Args:
        sources: episodes of each source.
        shares: each source's share of the draws.
        seed: seed of weights, dropout and the order of the draws.
        state: file to resume from, and to write to.
        start: weights to start from (fine-tuning); new ones when None.

    Raises:
        FileFormatError: `state` cannot be read, or belongs to another training.
    """
    device = chosen_device(config)
    sampler = MixtureSampler(
        [len(source) for source in sources],
        shares,
        seed,
        config.steps * config.batch,
        content="-".join(source.digest for source in sources),
    )
    loader = MixtureLoader(sources, sampler, config.batch, collate=collate_sequences)
    per_pass = max(sum(len(source) for source in sources) // config.batch, 1)
    # Dropout and initial weights draw from torch's own generator; the caller's is left alone.
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        model = build_model(tokens, config.model).to(device)
        if start is not None:
            model.load_state_dict(start)
        optimizer = torch.optim.AdamW(
            model.parameters(), config.learning_rate, weight_decay=config.weight_decay
        )
        schedule = torch.optim.lr_scheduler.LambdaLR(
            optimizer, partial(learning_rate_factor, steps=config.steps)
        )
        made_by = json.dumps([config.to_json(), seed], sort_keys=True)
        training = _Training(model, optimizer, schedule, loader, made_by)
        done = 0
        if state.is_file():
            done = _restore(state, training)
            watcher.step(done, None)
        model.train()
        batches = _batches(loader, sources, range(done, config.steps), per_pass)
        # The next batch is read while the device works on this one.
        with closing(made_ahead(batches, watcher.waited)) as coming:
            for batch, draws in coming:
                loss = _step(training, _to(batch, device), config)
                schedule.step()
                done += 1
                watcher.step(done, loss)
                if done % config.checkpoint_every == 0 or done == config.steps:
                    # Before the state: what is killed in between is done again.
                    watcher.checkpoint(model, done)
                    _save(state, done, draws, training)
    return model.eval()


def _batches(
    loader: MixtureLoader, sources: Sequence[CachedSequences], steps: range, per_pass: int
) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Yield the batch of each step, and the loader's position after it."""
    batches = iter(loader)
    for step in steps:
        for source in sources:
            source.begin_pass(step // per_pass)
        yield next(batches), loader.state_dict()


@dataclass(frozen=True)
class _Training:
    """State of a training."""

    model: Model
    optimizer: torch.optim.Optimizer
    schedule: torch.optim.lr_scheduler.LambdaLR
    loader: MixtureLoader
    made_by: str


def learning_rate_factor(step: int, steps: int) -> float:
    """Return the factor of the learning rate at `step`: linear warm-up over a tenth, cosine decay.

    Above 0 at every step 0 … steps − 1.
    """
    warm_up = max(round(0.1 * steps), 1)
    if step < warm_up:
        return (step + 1) / warm_up
    return 0.5 + 0.5 * math.cos(math.pi * (step - warm_up) / max(steps - warm_up, 1))


def _step(training: _Training, batch: dict[str, Any], config: TrainConfig) -> float:
    model, optimizer = training.model, training.optimizer
    if not config.model.frozen_language:
        batch["tokens"] = _forgetting(batch["tokens"], config.unknown)
    on_gpu = batch["mask"].is_cuda
    # bfloat16 has float32's range, so that no loss need be scaled.
    with torch.autocast("cuda", torch.bfloat16, enabled=on_gpu):
        loss = training_loss(model, batch, config)
    optimizer.zero_grad(set_to_none=True)
    loss.backward()
    torch.nn.utils.clip_grad_norm_(model.parameters(), _MAX_GRADIENT)
    optimizer.step()
    return float(loss.detach())


def _forgetting(tokens: Tensor, part: float) -> Tensor:
    """Replace a part of the words by the unknown word."""
    forgotten = (torch.rand(tokens.shape) < part).to(tokens.device) & (tokens > _UNKNOWN)
    return tokens.masked_fill(forgotten, _UNKNOWN)


def _to(batch: dict[str, Any], device: torch.device) -> dict[str, Any]:
    return {k: v.to(device) if torch.is_tensor(v) else v for k, v in batch.items()}


def _save(path: Path, done: int, draws: dict[str, Any], training: _Training) -> None:
    state = {
        "done": done,
        "made_by": training.made_by,
        "model": training.model.state_dict(),
        "optimizer": training.optimizer.state_dict(),
        "schedule": training.schedule.state_dict(),
        "draws": draws,
        "random": torch.get_rng_state(),
        # Dropout on a GPU draws from that GPU's generator.
        "random_cuda": torch.cuda.get_rng_state_all() if torch.cuda.is_available() else [],
    }
    with atomic_file(path) as temporary:
        torch.save(state, temporary)


def _restore(path: Path, training: _Training) -> int:
    """Return the number of steps done; see `train_model` for the errors."""
    try:
        state = torch.load(path, weights_only=True, map_location="cpu")
        if state["made_by"] != training.made_by:
            raise FileFormatError(
                path, "the state of a training run with other settings; use another output folder"
            )
        training.model.load_state_dict(state["model"])
        training.optimizer.load_state_dict(state["optimizer"])
        training.schedule.load_state_dict(state["schedule"])
        training.loader.load_state_dict(state["draws"])
        torch.set_rng_state(state["random"])
        # A training begun on other devices goes on with what this machine has.
        for number, value in enumerate(state["random_cuda"][: torch.cuda.device_count()]):
            torch.cuda.set_rng_state(value, number)
        return int(state["done"])
    except _DAMAGED as error:
        raise FileFormatError(
            path, f"not the state of this training run; delete it to start again ({error})"
        ) from error
