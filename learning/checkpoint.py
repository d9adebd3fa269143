"""Checkpoints: weights as safetensors, and beside them their card with the same name."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor, nn
from torch.overrides import TorchFunctionMode

from ..formats.core.atomic import write_bytes
from ..formats.core.errors import FileFormatError, InputError
from ..formats.untrusted.files import read_input
from .card import SUFFIX, Card, card_path, read_card, write_card
from .models.registry import Model, build_model

HEADER_BYTES = 1 << 20  # at most
BYTES_PER_WEIGHT = 8  # at most


@dataclass(frozen=True)
class Checkpoint:
    """A trained model and its card.

    Attributes:
        model: in evaluation mode, on the CPU, in float32.
        sha256: digest of the file of weights.
    """

    card: Card
    model: Model
    sha256: str


class _Unfilled(TorchFunctionMode):
    """Leave out normal random numbers.

    On the device `meta` they would import PyTorch's compiler, which takes seconds, asks for the
    user's name and makes a folder.
    """

    def __torch_function__(self, func, types, args=(), kwargs=None):
        """See `TorchFunctionMode`."""
        values = kwargs or {}
        if func in (torch.Tensor.normal_, nn.init.normal_):
            return args[0] if args else values["tensor"]
        return func(*args, **values)


def save_checkpoint(path: Path, model: Model, card: Card) -> None:
    """Write the weights, in half precision, and then the card.

    Args:
        path: file of the weights, `.safetensors`.
        model: on any device.
    """
    if path.suffix != SUFFIX:
        raise InputError(f"{path}: a checkpoint's file ends in {SUFFIX}")
    weights = {
        name: value.detach().to("cpu", torch.float16).contiguous()
        for name, value in model.state_dict().items()
    }
    raw = save(weights)
    write_bytes(path, raw)
    write_card(path, card, hashlib.sha256(raw).hexdigest())


def load_checkpoint(path: Path) -> Checkpoint:
    """Read a checkpoint.

    Raises:
        FileFormatError: card or weights are missing, damaged, of another version, or do not belong
            together.
    """
    card, digest = read_card(path)
    # Of a model without memory: a card may describe more than any machine has.
    with torch.device("meta"), _Unfilled():
        shapes = build_model(card.tokens, card.config.model, pretrained=False).state_dict()
    most = HEADER_BYTES + sum(value.numel() * BYTES_PER_WEIGHT for value in shapes.values())
    raw = read_input(path, max_bytes=most)
    actual = hashlib.sha256(raw).hexdigest()
    if actual != digest:
        raise FileFormatError(
            path, f"not the weights that {card_path(path).name} describes, or damaged (SHA-256)"
        )
    try:
        weights = load(raw)
    except SafetensorError as error:
        raise FileFormatError(path, f"not a safetensors file ({error})") from error
    _check_weights(path, weights, shapes)
    with torch.random.fork_rng():
        model = build_model(card.tokens, card.config.model, pretrained=False)
    model.load_state_dict({name: value.float() for name, value in weights.items()})
    return Checkpoint(card, model.eval(), actual)


def _check_weights(path: Path, weights: Mapping[str, Tensor], shapes: Mapping[str, Tensor]) -> None:
    wrong = sorted(set(shapes) ^ set(weights))
    if wrong:
        raise FileFormatError(path, f"missing or unexpected weights: {', '.join(wrong[:5])}")
    for name, value in weights.items():
        if value.shape != shapes[name].shape:
            raise FileFormatError(
                path, f"{name} is {tuple(value.shape)}; the card says {tuple(shapes[name].shape)}"
            )
        if not torch.isfinite(value).all():
            raise FileFormatError(path, f"{name} holds values that are not finite")
