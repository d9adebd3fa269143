"""A compact cross-modal attention agent, after CMA (Krantz et al., Beyond the Nav-Graph, 2020).

One recurrent state follows what was seen and done; it attends to the instruction, the words attend
to the places in the images, and a second recurrent state decides. As in CMA the first state does
not depend on the second, so a whole episode is computed at once.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn
from torch.nn.utils.rnn import pack_padded_sequence, pad_packed_sequence

from ..sequences import ACTIONS
from .config import ModelConfig
from .encoders import DEPTH_SCALE_M, CompactEncoder, rgb_encoder

FUTURE = 8  # poses ahead


class Agent(nn.Module):
    """Predicts action, waypoints, whether the end is near, and progress at every step."""

    def __init__(self, words: int, config: ModelConfig):
        """Build it for a vocabulary of `words`."""
        super().__init__()
        hidden = config.hidden
        self.rgb = rgb_encoder(config)
        self.depth = CompactEncoder(1, config.channels)
        seen = self.rgb.features + self.depth.features
        self.embedding = nn.Embedding(words, config.words, padding_idx=0)
        self.reader = nn.GRU(config.words, hidden // 2, batch_first=True, bidirectional=True)
        self.done = nn.Embedding(ACTIONS + 1, 32)
        self.first = nn.GRU(seen + 32, hidden, batch_first=True)
        self.ask_words = nn.Linear(hidden, 2 * (hidden // 2))
        self.ask_rgb = nn.Linear(2 * (hidden // 2), self.rgb.features)
        self.ask_depth = nn.Linear(2 * (hidden // 2), self.depth.features)
        self.second = nn.GRU(2 * seen + 32 + hidden + 2 * (hidden // 2), hidden, batch_first=True)
        self.dropout = nn.Dropout(config.dropout)
        self.act = nn.Linear(hidden, ACTIONS)
        self.walk = nn.Linear(hidden, FUTURE * 3)
        self.end = nn.Linear(hidden, 2)

    def forward(self, batch: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Predictions for a batch of `collate_sequences`.

        Returns:
            `action` (B, T, 4) logits, `waypoints` (B, T, 8, 3) [m, m, rad], `stop` (B, T) logit,
            `progress` (B, T).
        """
        real = batch["mask"]
        rgb = _placed(self.rgb(batch["rgb"][real].float() / 255.0), real)
        near = (batch["depth"][real] / DEPTH_SCALE_M).clamp(0.0, 1.0)
        far = _placed(self.depth(near), real)
        seen = self.dropout(torch.cat([rgb.mean(2), far.mean(2)], -1))
        done = self.done(batch["previous_action"])
        state, _ = self.first(torch.cat([seen, done], -1))

        tokens = batch["tokens"]
        lengths = (tokens != 0).sum(1).clamp(min=1)
        tokens = tokens[:, : int(lengths.max())]
        # Packed, for the direction that reads backwards must begin at each instruction's own end.
        packed = pack_padded_sequence(
            self.dropout(self.embedding(tokens)), lengths.cpu(), True, enforce_sorted=False
        )
        words, _ = pad_packed_sequence(self.reader(packed)[0], batch_first=True)
        attended = _attend(self.ask_words(state), words, tokens == 0)
        looked = [
            _look(self.ask_rgb(attended), rgb),
            _look(self.ask_depth(attended), far),
        ]
        joined = torch.cat([state, attended, *looked, seen, done], -1)
        state, _ = self.second(self.dropout(joined))
        state = self.dropout(state)
        end = self.end(state)
        return {
            "action": self.act(state),
            "waypoints": self.walk(state).unflatten(-1, (FUTURE, 3)),
            "stop": end[..., 0],
            "progress": end[..., 1],
        }


def _placed(features: Tensor, real: Tensor) -> Tensor:
    """Features of the real steps (N, S, C) among all steps (B, T, S, C), zeros elsewhere."""
    places = features.new_zeros((*real.shape, *features.shape[1:]))
    places[real] = features
    return places


def _attend(asked: Tensor, words: Tensor, padding: Tensor) -> Tensor:
    """Mean of words (B, L, C) as each step (B, T, C) weighs them."""
    score = asked @ words.transpose(1, 2) / words.shape[-1] ** 0.5
    return score.masked_fill(padding[:, None], -1e4).softmax(-1) @ words


def _look(asked: Tensor, places: Tensor) -> Tensor:
    """Mean of places (B, T, S, C) as their step (B, T, C) weighs them."""
    score = (places @ asked[..., None])[..., 0] / places.shape[-1] ** 0.5
    return (score.softmax(-1)[..., None, :] @ places)[..., 0, :]
