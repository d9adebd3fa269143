"""Seq2Seq (Krantz et al., "Beyond the Nav-Graph", ECCV 2020): one recurrent state for everything.

Images and the whole instruction's summary enter it at every step. Unlike CMA it does not attend,
and does not see its previous action.
"""

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from ..config import ModelConfig
from .cma import Memory
from .heads import Heads
from .senses import GRID, Read, Reader, Senses


class Seq2Seq(nn.Module):
    """Predicts action, waypoints, whether the end is near, and progress at every step."""

    def __init__(self, words: int, config: ModelConfig, *, pretrained: bool = True):
        """Build it for a vocabulary of `words`."""
        super().__init__()
        hidden = config.hidden
        self.senses = Senses(config, pretrained=pretrained)
        self.reader = Reader(words, config)
        self.see_rgb = nn.Linear(GRID * GRID * self.senses.rgb_width, hidden)
        self.see_depth = nn.Linear(GRID * GRID * self.senses.depth_width, hidden)
        self.recurrent = nn.GRU(3 * hidden, hidden, batch_first=True)
        self.dropout = nn.Dropout(config.dropout)
        self.heads = Heads(hidden)

    def forward(self, batch: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Return the predictions for a batch of `collate_sequences`; see `Heads`."""
        return self.advance(self.reader(batch["tokens"]), batch, None)[0]

    def advance(
        self, read: Read, batch: Mapping[str, Tensor], memory: Memory | None
    ) -> tuple[dict[str, Tensor], Memory]:
        """Predict T further steps of episodes; see `Cma.advance`."""
        seen = self.senses(batch)
        rgb = torch.relu(self.see_rgb(self.dropout(seen.rgb.flatten(2))))
        depth = torch.relu(self.see_depth(self.dropout(seen.depth.flatten(2))))
        words = read.summary[:, None].expand(-1, rgb.shape[1], -1)
        state, last = self.recurrent(
            torch.cat([rgb, depth, words], -1), memory[0] if memory else None
        )
        return self.heads(self.dropout(state)), (last,)
