"""Parts that the models share: vision, language and attention."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import adaptive_avg_pool2d
from torch.nn.utils.rnn import pack_padded_sequence, pad_packed_sequence

from ...formats.core.errors import FileFormatError
from ..config import GRID, OWN, ModelConfig
from .encoders import CompactEncoder, rgb_encoder

DEPTH_SCALE_M = 10.0  # farther away all walls are alike
_PLACE_WIDTH = 16  # of the learned vector that says which place a feature is of


@dataclass(frozen=True)
class Seen:
    """Image features of B episodes with T steps.

    Attributes:
        rgb, depth: (B, T, 16, C) features of the places of a 4 × 4 grid.
    """

    rgb: Tensor
    depth: Tensor


class Read(NamedTuple):
    """Instructions of B episodes.

    Attributes:
        words: (B, L, H) features of the words.
        padding: (B, L) true after the last word.
        summary: (B, H) of the whole instruction.
    """

    words: Tensor
    padding: Tensor
    summary: Tensor


class Senses(nn.Module):
    """Encode RGB and depth images.

    Attributes:
        rgb_width, depth_width: C of `Seen.rgb` and `Seen.depth`.
    """

    def __init__(self, config: ModelConfig, *, pretrained: bool = True):
        """Build the encoders."""
        super().__init__()
        self.rgb = rgb_encoder(config, pretrained=pretrained)
        self.depth = CompactEncoder(1, config.channels)
        self.rgb_place, self.depth_place = (
            nn.Parameter(nn.init.normal_(torch.empty(GRID * GRID, _PLACE_WIDTH), std=0.1))
            for _ in range(2)
        )
        self.rgb_width = self.rgb.features + _PLACE_WIDTH
        self.depth_width = self.depth.features + _PLACE_WIDTH
        self._inputs = config.inputs

    def forward(self, batch: Mapping[str, Tensor]) -> Seen:
        """Encode the real steps of a batch; features of inputs that the model lacks are zero.

        `rgb` has images in uint8, or the features of a pretrained encoder.
        """
        real = batch["mask"]
        if "rgb" in self._inputs:
            images = batch["rgb"][real]
            scale = 255.0 if images.dtype == torch.uint8 else 1.0
            rgb = self._grid(self.rgb(images.float() / scale), self.rgb_place, real)
        else:
            rgb = self.rgb_place.new_zeros(*real.shape, GRID * GRID, self.rgb_width)
        if "depth" in self._inputs:
            near = (fill_depth(batch["depth"][real]) / DEPTH_SCALE_M).clamp(0.0, 1.0)
            depth = self._grid(self.depth(near), self.depth_place, real)
        else:
            depth = self.depth_place.new_zeros(*real.shape, GRID * GRID, self.depth_width)
        return Seen(rgb, depth)

    @staticmethod
    def _grid(features: Tensor, place: Tensor, real: Tensor) -> Tensor:
        """Return maps (N, C, H, W) of the real steps as places (B, T, 16, C + 16), else zeros."""
        pooled = adaptive_avg_pool2d(features, GRID).flatten(2).transpose(1, 2)
        places = torch.cat([pooled, place.expand(pooled.shape[0], -1, -1).to(pooled.dtype)], -1)
        result = places.new_zeros((*real.shape, *places.shape[1:]))
        result[real] = places
        return result


class Reader(nn.Module):
    """Read instructions in both directions."""

    def __init__(self, words: int, config: ModelConfig):
        """Build it for a vocabulary of `words`; its features have `config.hidden` numbers."""
        super().__init__()
        if config.language == OWN:
            self.embedding = nn.Embedding(words, config.words, padding_idx=0)
        else:
            self.embedding = nn.Linear(config.language_width, config.words)
        self.recurrent = nn.GRU(
            config.words, config.hidden // 2, batch_first=True, bidirectional=True
        )
        self.dropout = nn.Dropout(config.dropout)
        self._hidden = config.hidden
        self._deaf = "instruction" not in config.inputs

    def forward(self, tokens: Tensor) -> Read:
        """Read word indices (B, L) int64, or a pretrained encoder's features (B, L, C).

        Behind an instruction's end they are zero. Without the input `instruction` so is the result.
        """
        if self._deaf:
            zeros = self.embedding.weight.new_zeros(len(tokens), 1, self._hidden)
            return Read(zeros, tokens.new_zeros(len(tokens), 1, dtype=torch.bool), zeros[:, 0])
        real = tokens.any(-1) if tokens.is_floating_point() else tokens != 0
        lengths = real.sum(1).clamp(min=1)
        tokens, real = (values[:, : int(lengths.max())] for values in (tokens, real))
        if tokens.is_floating_point():
            tokens = tokens.float()
        # Packed, for the direction that reads backwards must begin at each instruction's own end.
        packed = pack_padded_sequence(
            self.dropout(self.embedding(tokens)), lengths.cpu(), True, enforce_sorted=False
        )
        output, last = self.recurrent(packed)
        words, _ = pad_packed_sequence(output, batch_first=True)
        return Read(words, ~real, torch.cat([last[0], last[1]], -1))


def fill_depth(depth_m: Tensor) -> Tensor:
    """Return depth (..., H, W) with the nearest measured pixel below in place of unmeasured ones.

    What no camera measures is mostly high: the sky over a building without ceilings. Its 0 m would
    look like a wall before the lens. Pixels with nothing measured below them stay 0.
    """
    upwards = depth_m.flip(-2)
    rows = torch.arange(depth_m.shape[-2], device=depth_m.device)[:, None]
    below = torch.where(upwards > 0, rows, 0).cummax(-2).values
    return upwards.gather(-2, below).flip(-2)


def load_word_vectors(embedding: nn.Embedding, vocabulary: tuple[str, ...], path: Path) -> int:
    """Set the vectors of the words that a text file of word vectors (GloVe's format) knows.

    Returns:
        How many words of the vocabulary it knows.

    Raises:
        FileFormatError: the file cannot be read, or its vectors have another size.
    """
    place = {word: number for number, word in enumerate(vocabulary)}
    count = 0
    try:
        with path.open(encoding="utf-8") as lines, torch.no_grad():
            for number, line in enumerate(lines, 1):
                word, *values = line.split()
                if word not in place:
                    continue
                if len(values) != embedding.embedding_dim:
                    raise FileFormatError(
                        path,
                        f"line {number}: {len(values)} numbers; the model's `words` is "
                        f"{embedding.embedding_dim}",
                    )
                embedding.weight[place[word]] = torch.tensor([float(value) for value in values])
                count += 1
    except (OSError, ValueError) as error:
        raise FileFormatError(path, f"not readable as word vectors ({error})") from error
    return count


def attend(query: Tensor, read: Read) -> Tensor:
    """Return the mean of the words (B, T, H) as each step's question (B, T, H) weighs them."""
    score = query @ read.words.transpose(1, 2) / read.words.shape[-1] ** 0.5
    return score.masked_fill(read.padding[:, None], -1e4).softmax(-1) @ read.words


def look(query: Tensor, places: Tensor) -> Tensor:
    """Return the mean of places (B, T, S, C) as their step's question (B, T, C) weighs them."""
    score = (places @ query[..., None])[..., 0] / places.shape[-1] ** 0.5
    return (score.softmax(-1)[..., None, :] @ places)[..., 0, :]
