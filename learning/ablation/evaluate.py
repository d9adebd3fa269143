"""Scores on held-out episodes, of agents and of baselines without training."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ...datasets.sequences import ACTIONS, collate_sequences
from ..models.registry import Model
from ..training.cache import CachedSequences
from ..training.losses import near_end

_BATCH = 8


@dataclass(frozen=True)
class EpisodeScore:
    """Counts over one episode's steps, which can be summed over any set of episodes.

    Attributes:
        trajectory: `scene/trajectory`.
        frames: steps.
        correct: steps whose action was predicted.
        waypoint_error_m: sum of the distances between predicted and true waypoints.
        waypoints: number of those waypoints.
        near, near_found: steps near the end, and how many of them were predicted as such.
        far, far_found: the other steps, and how many of them were predicted as such.
    """

    trajectory: str
    frames: int
    correct: int
    waypoint_error_m: float
    waypoints: int
    near: int
    near_found: int
    far: int
    far_found: int

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return asdict(self)


@dataclass(frozen=True)
class Summary:
    """Episodes summed up: parts 0 … 1, and metres.

    Attributes:
        action: part of the steps whose action was predicted.
        waypoint_m: mean distance of the waypoints of the next 8 steps.
        stop: mean of the parts of near and of other steps that were classified correctly; 0.5 is
            chance.
    """

    action: float
    waypoint_m: float
    stop: float

    @staticmethod
    def of(scores: list[EpisodeScore]) -> "Summary":
        """Return the summary of some episodes."""

        def total(name: str) -> float:
            return sum(getattr(score, name) for score in scores)

        near = total("near_found") / max(total("near"), 1)
        far = total("far_found") / max(total("far"), 1)
        return Summary(
            total("correct") / total("frames"),
            total("waypoint_error_m") / max(total("waypoints"), 1),
            (near + far) / 2,
        )


@torch.no_grad()
def score_model(model: Model, episodes: CachedSequences) -> list[EpisodeScore]:
    """Predict each step's action, waypoints and end, given the true steps before it."""
    device = next(model.parameters()).device
    trajectories = episodes.sequences.selection.trajectories()
    result = []
    for first, batch in _batches(episodes):
        moved = {k: v.to(device) if torch.is_tensor(v) else v for k, v in batch.items()}
        predicted = {k: v.cpu() for k, v in model(moved).items()}
        action = predicted["action"].argmax(-1).numpy()
        stop = (predicted["stop"] > 0).numpy()
        walk = predicted["waypoints"].numpy()
        result += [
            _score(str(trajectories[first + n]), batch, n, action[n], walk[n], stop[n])
            for n in range(len(batch["length"]))
        ]
    return result


def score_constant(episodes: CachedSequences) -> list[EpisodeScore]:
    """Return the score of the best constants of these episodes: commonest action, mean waypoints.

    "Always near the end" and "never" both have a stop accuracy of 0.5.
    """
    counts = np.zeros(ACTIONS, np.int64)
    total: Any = 0.0
    valid: Any = 0
    for _, batch in _batches(episodes):
        counts += np.bincount(batch["action"][batch["mask"]].numpy(), minlength=ACTIONS)
        there = (batch["waypoint_valid"] & batch["mask"][..., None])[..., None].numpy()
        total = total + (batch["waypoints"].numpy() * there).sum((0, 1))
        valid = valid + there.sum((0, 1))
    mean = total / np.maximum(valid, 1)
    return _scores_without_agent(
        episodes,
        lambda batch, n: (
            np.full(batch["action"].shape[1], counts.argmax()),
            np.broadcast_to(mean, batch["waypoints"].shape[1:]),
        ),
    )


def score_repeat(episodes: CachedSequences) -> list[EpisodeScore]:
    """Return the score of repeating the previous action, and the previous motion eight times."""

    def predict(batch: Any, n: int) -> tuple[NDArray, NDArray]:
        # The first step repeats nothing; walking on is the best guess there.
        action = batch["previous_action"][n].numpy() - 1
        action[0] = 1
        motion = np.roll(batch["motion"][n].numpy(), 1, axis=0)
        motion[0] = 0.0
        return action, _repeated(motion, batch["waypoints"].shape[2])

    return _scores_without_agent(episodes, predict)


def _repeated(motion: NDArray[np.float32], future: int) -> NDArray[np.float64]:
    """Return the waypoints (T, F, 3) reached by repeating each motion (T, 3)."""
    pose = np.zeros((len(motion), 3))
    waypoints = []
    for _ in range(future):
        c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        x, y, turn = motion.T
        step = np.stack([c * x - s * y, s * x + c * y, turn], -1)
        pose = pose + step
        waypoints.append(pose)
    return np.stack(waypoints, axis=1)


def _scores_without_agent(episodes: CachedSequences, predict: Any) -> list[EpisodeScore]:
    trajectories = episodes.sequences.selection.trajectories()
    result = []
    for first, batch in _batches(episodes):
        never = np.zeros(batch["action"].shape[1], bool)
        for n in range(len(batch["length"])):
            action, walk = predict(batch, n)
            result.append(_score(str(trajectories[first + n]), batch, n, action, walk, never))
    return result


def _score(
    trajectory: str,
    batch: dict[str, Any],
    n: int,
    action: NDArray,
    waypoints: NDArray,
    stop: NDArray[np.bool_],
) -> EpisodeScore:
    steps = int(batch["length"][n])
    truth = batch["waypoints"][n, :steps, :, :2].numpy()
    error = np.linalg.norm(waypoints[:steps, :, :2] - truth, axis=-1)
    valid = batch["waypoint_valid"][n, :steps].numpy()
    near = near_end(batch)[n, :steps].numpy()
    return EpisodeScore(
        trajectory=trajectory,
        frames=steps,
        correct=int((action[:steps] == batch["action"][n, :steps].numpy()).sum()),
        waypoint_error_m=float(error[valid].sum()),
        waypoints=int(valid.sum()),
        near=int(near.sum()),
        near_found=int((stop[:steps] & near).sum()),
        far=int((~near).sum()),
        far_found=int((~stop[:steps] & ~near).sum()),
    )


def _batches(episodes: CachedSequences) -> Iterator[tuple[int, dict[str, Any]]]:
    for first in range(0, len(episodes), _BATCH):
        numbers = range(first, min(first + _BATCH, len(episodes)))
        yield first, collate_sequences([episodes[n] for n in numbers])
