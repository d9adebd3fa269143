"""Recurrent diffusion policy (RDP), VLN-PE's baseline for continuous waypoints.

A recurrent state follows the images, the pose relative to the start and the last four poses. It and
the image tokens attend to the words, and the words to them; the result conditions a transformer
that removes the noise from the next eight motions. A head of its own predicts how much of the way
is done, from which it stops. Where the paper's encoders are pretrained (LongCLIP), the ones here
are those of `ModelConfig`.
"""

import math
from collections.abc import Mapping

import torch
from torch import Tensor, nn
from torch.nn.functional import adaptive_avg_pool2d, mse_loss

from ...formats.core.rollout import FORWARD_STEP_M, TURN_STEP_RAD
from ..config import ModelConfig
from .cma import Memory
from .diffusion import NoiseSchedule
from .heads import FUTURE
from .senses import GRID, Read, Reader, Senses

PAST = 4  # poses before, seen from the present one
EXECUTED = 4  # of the FUTURE motions, before the next prediction
STILL = 0.1  # all normalised motions below it mean stop
STOP_PROGRESS = 0.8  # so does a predicted progress above it
_POSE_SCALE = 5.0  # m; brings poses relative to the start to the size of the other features
_HEADS = 4
# Motions of discrete steps, which walking robots overshoot at times, are normalised to −1 … 1.
MOTION_SCALE = (1.5 * FORWARD_STEP_M, 1.5 * FORWARD_STEP_M, 1.5 * TURN_STEP_RAD)


class Rdp(nn.Module):
    """Predicts the noise in the next eight motions, and the progress to the stop."""

    scale: Tensor

    def __init__(self, words: int, config: ModelConfig, *, pretrained: bool = True):
        """Build it for a vocabulary of `words`."""
        super().__init__()
        hidden = config.hidden
        self.senses = Senses(config, pretrained=pretrained)
        self.reader = Reader(words, config)
        self.token_rgb = nn.Linear(self.senses.rgb_width, hidden)
        self.token_depth = nn.Linear(GRID * GRID * self.senses.depth_width, hidden)
        self.where = nn.Linear(4 * (1 + PAST), hidden)
        self.recurrent = nn.GRU(6 * hidden, hidden, batch_first=True)
        self.ask_words = nn.MultiheadAttention(hidden, _HEADS, config.dropout, batch_first=True)
        self.ask_images = nn.MultiheadAttention(hidden, _HEADS, config.dropout, batch_first=True)
        self.dropout = nn.Dropout(config.dropout)

        def block(kind: type[nn.Module]) -> nn.Module:
            return kind(hidden, _HEADS, 2 * hidden, config.dropout, batch_first=True)

        self.encode = block(nn.TransformerEncoderLayer)
        self.decode = nn.ModuleList(block(nn.TransformerDecoderLayer) for _ in range(config.layers))
        self.enter = nn.Linear(3, hidden)
        self.order = nn.Parameter(nn.init.normal_(torch.empty(FUTURE, hidden), std=0.1))
        self.level = nn.Sequential(nn.Linear(hidden, hidden), nn.SiLU(), nn.Linear(hidden, hidden))
        self.leave = nn.Linear(hidden, 3)
        self.end_attention = block(nn.TransformerEncoderLayer)
        self.end = nn.Sequential(nn.Linear(hidden, hidden), nn.ReLU(), nn.Linear(hidden, 1))
        self.schedule = NoiseSchedule(config.diffusion_steps)
        self.register_buffer("scale", torch.tensor(MOTION_SCALE), persistent=False)

    def advance(
        self, read: Read, batch: Mapping[str, Tensor], memory: Memory | None
    ) -> tuple[dict[str, Tensor], Memory]:
        """Condition T further steps of episodes; see `Cma.advance`.

        Returns:
            `condition` (B, T, K, H), and `progress` (B, T) in 0 … 1; the memory.
        """
        seen = self.senses(batch)
        steps = seen.rgb.shape[:2]
        tokens = torch.relu(self.token_rgb(self.dropout(_five(seen.rgb))))
        depth = torch.relu(self.token_depth(self.dropout(seen.depth.flatten(2))))
        tokens = torch.cat([tokens[..., :1, :] + depth[..., None, :], tokens[..., 1:, :]], -2)
        where = self.where(_positions(batch))
        state, last = self.recurrent(
            torch.cat([tokens.flatten(2), where], -1), memory[0] if memory else None
        )
        vision = torch.cat([state[..., None, :], tokens], -2).flatten(0, 1)  # (B T, 6, H)
        words = read.words.repeat_interleave(steps[1], 0)
        padding = read.padding.repeat_interleave(steps[1], 0)
        attended, _ = self.ask_words(vision, words, words, key_padding_mask=padding)
        looked, _ = self.ask_images(words, vision, vision)
        word = (~padding)[..., None].to(looked.dtype)
        looked = (looked * word).sum(1, keepdim=True) / word.sum(1, keepdim=True).clamp(min=1)
        present = torch.stack([state, where], -2).flatten(0, 1)
        condition = torch.cat([attended, looked, present], 1)
        progress = self.end(self.end_attention(condition).mean(1))[:, 0].sigmoid()
        return {
            "condition": condition.unflatten(0, steps),
            "progress": progress.unflatten(0, steps),
        }, (last,)

    def loss(self, batch: Mapping[str, Tensor], stop_weight: float) -> Tensor:
        """Return the error of the predicted noise plus λ times that of the progress.

        Args:
            batch: batch of `collate_sequences`.
            stop_weight: λ.
        """
        conditioned, _ = self.advance(self.reader(batch["tokens"]), batch, None)
        motions, valid = future_motions(batch)
        real = batch["mask"] & valid.any(-1)
        clean = (motions[real] / self.scale).clamp(-1.0, 1.0)
        noise = torch.randn_like(clean)
        level = torch.randint(self.schedule.steps, (len(clean),), device=clean.device)
        encoded = self.encode(conditioned["condition"][real])
        guess = self._denoise(encoded, self.schedule.add_noise(clean, noise, level), level)
        error = (guess - noise).square().mean(-1)
        weight = valid[real]
        total = (error * weight).sum() / weight.sum().clamp(min=1)
        mask = batch["mask"]
        return total + stop_weight * mse_loss(
            conditioned["progress"][mask], batch["progress"][mask]
        )

    def sample(self, condition: Tensor, rng: torch.Generator) -> Tensor:
        """Return motions (N, 8, 3) Δx, Δy [m], Δyaw [rad] under conditions (N, K, H)."""
        encoded = self.encode(condition)
        start = torch.randn((len(condition), FUTURE, 3), generator=rng).to(condition.device)
        return self.scale * self.schedule.sample(
            lambda noisy, level: self._denoise(encoded, noisy, level), start, rng
        )

    def _denoise(self, encoded: Tensor, noisy: Tensor, level: Tensor) -> Tensor:
        tokens = self.enter(noisy) + self.order
        tokens = tokens + self.level(_waves(level, tokens.shape[-1]))[:, None]
        for layer in self.decode:
            tokens = layer(tokens, encoded)
        return self.leave(tokens)


def future_motions(batch: Mapping[str, Tensor]) -> tuple[Tensor, Tensor]:
    """Return the next motions of every step of a batch of `collate_sequences`.

    After an episode's end the robot stands still, which is how a stop looks; after the place
    where an episode was cut the motions are unknown.

    Returns:
        Motions (B, T, 8, 3), each in the frame of the step that it begins at, and whether they are
        known (B, T, 8).
    """
    motion, length = batch["motion"], batch["length"]
    steps = motion.shape[1]
    ahead = torch.arange(steps, device=motion.device)[:, None] + torch.arange(
        FUTURE, device=motion.device
    )
    inside = ahead[None] < (length - 1)[:, None, None]
    values = motion[:, ahead.clamp(max=steps - 1)] * inside[..., None]
    return values, inside | ~batch["cut"][:, None, None]


def still(motions: Tensor) -> Tensor:
    """Return (N,) whether predicted motions (N, 8, 3) all mean standing still."""
    scale = motions.new_tensor(MOTION_SCALE)
    return ((motions / scale).abs() < STILL).flatten(1).all(1)


def _positions(batch: Mapping[str, Tensor]) -> Tensor:
    """Return the pose from the start and the last four poses from here, (B, T, 5 · 4).

    In closed loop, where earlier steps are not part of the batch, `batch["past"]` holds the latter;
    otherwise they follow from `pose` (B, T, 3).
    """
    pose = batch["pose"]
    if "past" in batch:
        past = batch["past"]
    else:
        steps = pose.shape[1]
        index = torch.arange(steps, device=pose.device)[:, None]
        index = index - torch.arange(1, PAST + 1, device=pose.device)
        before = pose[:, index.clamp(min=0)]
        past = seen_from(before, pose[:, :, None])
    start = _angles(torch.cat([pose[..., :2] / _POSE_SCALE, pose[..., 2:]], -1))
    return torch.cat([start, _angles(past).flatten(-2)], -1)


def seen_from(poses: Tensor, origin: Tensor) -> Tensor:
    """Return `poses` (…, 3) x, y [m], yaw [rad] in the frame of `origin` (…, 3)."""
    offset = poses[..., :2] - origin[..., :2]
    cos, sin = origin[..., 2].cos(), origin[..., 2].sin()
    x = cos * offset[..., 0] + sin * offset[..., 1]
    y = cos * offset[..., 1] - sin * offset[..., 0]
    return torch.stack([x, y, poses[..., 2] - origin[..., 2]], -1)


def _angles(pose: Tensor) -> Tensor:
    """Return x, y, cos yaw, sin yaw of poses; unlike the angle these never jump."""
    return torch.cat([pose[..., :2], pose[..., 2:].cos(), pose[..., 2:].sin()], -1)


def _five(places: Tensor) -> Tensor:
    """Return tokens of the whole image and its four quarters, (B, T, 5, C), of (B, T, 16, C)."""
    grid = places.unflatten(2, (GRID, GRID)).movedim(-1, 2).flatten(0, 1)
    quarters = adaptive_avg_pool2d(grid, 2).flatten(2).transpose(1, 2)
    quarters = quarters.unflatten(0, places.shape[:2])
    return torch.cat([places.mean(2, keepdim=True), quarters], 2)


def _waves(level: Tensor, width: int) -> Tensor:
    """Return the sinusoidal embedding (N, width) of levels (N,)."""
    half = width // 2
    rates = torch.exp(-math.log(1000.0) * torch.arange(half, device=level.device) / half)
    angles = level[:, None] * rates
    return torch.cat([angles.sin(), angles.cos()], -1)
