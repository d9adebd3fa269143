"""The training losses."""

from collections.abc import Mapping

import torch
from torch import Tensor
from torch.nn import functional

from ..config import TrainConfig
from ..models.rdp import Rdp
from ..models.registry import Model

NEAR_END_STEPS = 4  # "stop" means that the episode ends within these steps, 1 m


def near_end(batch: Mapping[str, Tensor]) -> Tensor:
    """Return (B, T) whether the episode ends within `NEAR_END_STEPS`; never where it was cut."""
    steps = torch.arange(batch["action"].shape[1], device=batch["action"].device)
    left = batch["length"][:, None] - 1 - steps[None]
    return (left <= NEAR_END_STEPS) & (left >= 0) & ~batch["cut"][:, None]


def training_loss(model: Model, batch: Mapping[str, Tensor], config: TrainConfig) -> Tensor:
    """Return a model's loss on a batch of `collate_sequences`."""
    if isinstance(model, Rdp):
        return model.loss(batch, config.stop_progress_weight)
    return imitation_loss(model(batch), batch, config)


def imitation_loss(
    predicted: Mapping[str, Tensor], batch: Mapping[str, Tensor], config: TrainConfig
) -> Tensor:
    """Return the loss over real steps: inflection-weighted imitation, waypoints, end, progress."""
    mask = batch["mask"].float()
    count = mask.sum()
    weight = batch["weight"] * mask
    action = functional.cross_entropy(
        predicted["action"].flatten(0, 1), batch["action"].flatten(), reduction="none"
    )
    total = (action * weight.flatten()).sum() / weight.sum()

    valid = (batch["waypoint_valid"] & batch["mask"][..., None])[..., None]
    walk = functional.smooth_l1_loss(
        predicted["waypoints"], batch["waypoints"], reduction="none", beta=0.2
    )
    total = total + config.waypoint_weight * (walk * valid).sum() / valid.sum().clamp(min=1)

    end = near_end(batch).float()
    # As much weight to the few steps near the end as to all others.
    balance = ((count - (end * mask).sum()) / (end * mask).sum().clamp(min=1)).clamp(max=30.0)
    stop = functional.binary_cross_entropy_with_logits(
        predicted["stop"], end, reduction="none", pos_weight=balance
    )
    total = total + config.stop_weight * (stop * mask).sum() / count
    progress = (predicted["progress"] - batch["progress"]).square()
    return total + config.progress_weight * (progress * mask).sum() / count
