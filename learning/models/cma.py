"""Cross-modal attention (CMA; Krantz et al., "Beyond the Nav-Graph", ECCV 2020).

One recurrent state follows what was seen and done; it attends to the instruction, the attended
words attend to the places in the images, and a second recurrent state decides. The first state does
not depend on the second, so that a whole episode is computed at once. The progress monitor is one
of the heads; its loss has a weight.
"""

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from ..config import ModelConfig
from .heads import PREVIOUS_WIDTH, Heads, PreviousAction
from .senses import GRID, Read, Reader, Senses, attend, look

Memory = tuple[Tensor, ...]


class Cma(nn.Module):
    """Predicts action, waypoints, whether the end is near, and progress at every step."""

    def __init__(self, words: int, config: ModelConfig, *, pretrained: bool = True):
        """Build it for a vocabulary of `words`."""
        super().__init__()
        hidden = config.hidden
        self.senses = Senses(config, pretrained=pretrained)
        rgb, depth = self.senses.rgb_width, self.senses.depth_width
        self.reader = Reader(words, config)
        self.previous = PreviousAction()
        self.see_rgb = nn.Linear(GRID * GRID * rgb, hidden)
        self.see_depth = nn.Linear(GRID * GRID * depth, hidden)
        self.first = nn.GRU(2 * hidden + PREVIOUS_WIDTH, hidden, batch_first=True)
        self.ask_words = nn.Linear(hidden, hidden)
        self.ask_rgb = nn.Linear(hidden, rgb)
        self.ask_depth = nn.Linear(hidden, depth)
        joined = hidden + hidden + rgb + depth + PREVIOUS_WIDTH
        self.compress = nn.Sequential(nn.Linear(joined, hidden), nn.ReLU())
        self.second = nn.GRU(hidden, hidden, batch_first=True)
        self.dropout = nn.Dropout(config.dropout)
        self.heads = Heads(hidden)

    def forward(self, batch: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Return the predictions for a batch of `collate_sequences`; see `Heads`."""
        return self.advance(self.reader(batch["tokens"]), batch, None)[0]

    def advance(
        self, read: Read, batch: Mapping[str, Tensor], memory: Memory | None
    ) -> tuple[dict[str, Tensor], Memory]:
        """Predict T further steps of episodes; `memory` is what the last call returned.

        Args:
            batch: `rgb`, `depth`, `previous_action` and `mask` of the steps.
            memory: recurrent states; None at the start.
        """
        first, second = memory or (None, None)
        seen = self.senses(batch)
        done = self.previous(batch["previous_action"])
        rgb, depth = (
            torch.relu(line(self.dropout(places.flatten(2))))
            for line, places in ((self.see_rgb, seen.rgb), (self.see_depth, seen.depth))
        )
        state, first = self.first(torch.cat([rgb, depth, done], -1), first)
        attended = attend(self.ask_words(state), read)
        looked = [
            look(self.ask_rgb(attended), seen.rgb),
            look(self.ask_depth(attended), seen.depth),
        ]
        joined = torch.cat([attended, *looked, done, state], -1)
        state, second = self.second(self.compress(self.dropout(joined)), second)
        return self.heads(self.dropout(state)), (first, second)
