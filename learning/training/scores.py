"""Accuracy of a model on single steps, given the true steps before (teacher forcing)."""

from collections.abc import Sequence

import torch

from ...datasets.sequences import ACTIONS, collate_sequences
from ...formats.core.rollout import Action
from ..config import TrainConfig
from ..models.rdp import Rdp
from ..models.registry import Model
from .cache import CachedSequences
from .losses import training_loss

_BATCH = 8


@torch.no_grad()
def step_scores(
    model: Model, sources: Sequence[CachedSequences], config: TrainConfig
) -> dict[str, float]:
    """Return scores over all steps of all episodes.

    Returns:
        `loss`, and for models of discrete actions `action`, the part of the steps whose action is
        predicted; `constant`, the part that the commonest action is right about; `turn`, the part
        of the turns, and `stop`, of the stops that are predicted. Empty without episodes.
    """
    device = next(model.parameters()).device
    right = torch.zeros(ACTIONS)
    count = torch.zeros(ACTIONS)
    losses: list[float] = []
    with torch.random.fork_rng():  # a diffusion policy's loss draws
        torch.manual_seed(0)
        for source in sources:
            for first in range(0, len(source), _BATCH):
                numbers = range(first, min(first + _BATCH, len(source)))
                batch = collate_sequences([source[n] for n in numbers])
                batch = {k: v.to(device) if torch.is_tensor(v) else v for k, v in batch.items()}
                losses.append(float(training_loss(model, batch, config)))
                if isinstance(model, Rdp):
                    continue
                mask = batch["mask"]
                truth = batch["action"][mask].cpu()
                hit = model(batch)["action"].argmax(-1)[mask].cpu() == truth
                right += torch.bincount(truth, hit.float(), minlength=ACTIONS)
                count += torch.bincount(truth, minlength=ACTIONS)
    if not losses:
        return {}
    result = {"loss": sum(losses) / len(losses)}
    if isinstance(model, Rdp):
        return result
    turns = [Action.LEFT, Action.RIGHT]
    return result | {
        "action": float(right.sum() / count.sum()),
        "constant": float(count.max() / count.sum()),
        "turn": float(right[turns].sum() / count[turns].sum().clamp(min=1)),
        "stop": float(right[Action.STOP] / count[Action.STOP].clamp(min=1)),
    }
