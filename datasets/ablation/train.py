"""Train one agent on one mixture; an interrupted training goes on at its last checkpoint."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ...formats.core.atomic import atomic_file
from ..mixture.loader import MixtureLoader
from ..mixture.sampler import MixtureSampler
from ..selection import joined_digest
from ..sequences import collate_sequences
from ..tokens import Tokens
from .agent import Agent
from .cache import CachedSequences
from .config import TrainConfig
from .losses import loss_of

_UNKNOWN = 1  # the vocabulary's index of unknown words
_MAX_GRADIENT = 5.0


def chosen_device(config: TrainConfig) -> torch.device:
    """Return the device of the configuration."""
    if config.device == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    return torch.device(config.device)


def train_agent(
    sources: list[CachedSequences],
    shares: list[float],
    tokens: Tokens,
    config: TrainConfig,
    seed: int,
    checkpoint: Path,
    progress: Callable[[int], None],
) -> Agent:
    """Train for `config.steps` steps.

    Args:
        sources: episodes of each source.
        shares: of the draws.
        tokens: of the instructions.
        config: how.
        seed: of weights, dropout and the order of the draws.
        checkpoint: file to go on from, and to write to.
        progress: called with the number of steps done, after each step.
    """
    device = chosen_device(config)
    sampler = MixtureSampler(
        [len(source) for source in sources],
        shares,
        seed,
        config.steps * config.batch,
        content=joined_digest(source.sequences.selection for source in sources),
    )
    loader = MixtureLoader(sources, sampler, config.batch, collate=collate_sequences)
    # Dropout and initial weights draw from torch's own generator; the caller's is left alone.
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        agent = Agent(len(tokens.vocabulary.words), config.model).to(device)
        optimizer = torch.optim.AdamW(
            agent.parameters(), config.learning_rate, weight_decay=config.weight_decay
        )
        schedule = torch.optim.lr_scheduler.LambdaLR(
            optimizer, partial(learning_rate_factor, steps=config.steps)
        )
        done = 0
        if checkpoint.is_file():
            done = _restore(checkpoint, agent, optimizer, schedule, loader)
            progress(done)
        agent.train()
        batches = iter(loader) if done < config.steps else iter(())
        for batch in batches:
            _step(agent, optimizer, _to(batch, device), config)
            schedule.step()
            done += 1
            progress(done)
            if done % config.checkpoint_every == 0 or done == config.steps:
                _save(checkpoint, done, agent, optimizer, schedule, loader)
    return agent.eval()


def learning_rate_factor(step: int, steps: int) -> float:
    """Return the factor of the learning rate at `step`: linear warm-up over a tenth, cosine decay.

    Above 0 at every step 0 … steps − 1.
    """
    warm_up = max(round(0.1 * steps), 1)
    if step < warm_up:
        return (step + 1) / warm_up
    return 0.5 + 0.5 * math.cos(math.pi * (step - warm_up) / max(steps - warm_up, 1))


def _step(
    agent: Agent,
    optimizer: torch.optim.Optimizer,
    batch: dict[str, Any],
    config: TrainConfig,
) -> None:
    batch["tokens"] = _forgetting(batch["tokens"], config.unknown)
    loss = loss_of(agent(batch), batch, config)
    optimizer.zero_grad(set_to_none=True)
    loss.backward()
    torch.nn.utils.clip_grad_norm_(agent.parameters(), _MAX_GRADIENT)
    optimizer.step()


def _forgetting(tokens: Tensor, part: float) -> Tensor:
    """Replace a part of the words by the unknown word."""
    forgotten = (torch.rand(tokens.shape) < part).to(tokens.device) & (tokens > _UNKNOWN)
    return tokens.masked_fill(forgotten, _UNKNOWN)


def _to(batch: dict[str, Any], device: torch.device) -> dict[str, Any]:
    return {k: v.to(device) if torch.is_tensor(v) else v for k, v in batch.items()}


def _save(
    path: Path,
    done: int,
    agent: Agent,
    optimizer: torch.optim.Optimizer,
    schedule: Any,
    loader: MixtureLoader,
) -> None:
    state = {
        "done": done,
        "agent": agent.state_dict(),
        "optimizer": optimizer.state_dict(),
        "schedule": schedule.state_dict(),
        "draws": loader.state_dict(),
        "random": torch.get_rng_state(),
        # Dropout on a GPU draws from that GPU's generator.
        "random_cuda": torch.cuda.get_rng_state_all() if torch.cuda.is_available() else [],
    }
    with atomic_file(path) as temporary:
        torch.save(state, temporary)


def _restore(
    path: Path,
    agent: Agent,
    optimizer: torch.optim.Optimizer,
    schedule: Any,
    loader: MixtureLoader,
) -> int:
    state = torch.load(path, weights_only=True, map_location="cpu")
    agent.load_state_dict(state["agent"])
    optimizer.load_state_dict(state["optimizer"])
    schedule.load_state_dict(state["schedule"])
    loader.load_state_dict(state["draws"])
    torch.set_rng_state(state["random"])
    # A training begun on other devices goes on with what this machine has.
    for number, value in enumerate(state["random_cuda"][: torch.cuda.device_count()]):
        torch.cuda.set_rng_state(value, number)
    return int(state["done"])
