"""Settings of an ablation's training, from the `train` part of a recipe."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from ...formats.core.errors import InputError, UnknownNameError

ENCODERS = ("compact", "resnet18", "resnet34", "resnet50")


@dataclass(frozen=True)
class ModelConfig:
    """Size of the agent.

    Attributes:
        encoder: of RGB: `compact`, trained from scratch, or a network of torchvision.
        encoder_weights: file of that network's weights (a state dict); without it, it starts from
            scratch, too.
        train_encoder: false keeps its weights as they are.
        channels: of the compact encoders' stages; each halves the image.
        hidden: of the two recurrent states.
        words: of the word embedding.
        dropout: on features, 0 … 1.
    """

    encoder: str = "compact"
    encoder_weights: str = ""
    train_encoder: bool = True
    channels: tuple[int, ...] = (16, 32, 48)
    hidden: int = 96
    words: int = 32
    dropout: float = 0.2


@dataclass(frozen=True)
class TrainConfig:
    """How each row is trained; every row gets the same number of steps.

    Attributes:
        seeds: trainings per row.
        steps: of the optimiser.
        batch: episodes per step.
        learning_rate: at its highest; it falls to 0 along a cosine.
        weight_decay: of AdamW.
        size_px: side of the images.
        max_steps: frames per episode at most.
        tokens: words per instruction.
        unknown: part of the words that training replaces by the unknown word, so that it learns
            what to do about it.
        waypoint_weight, stop_weight, progress_weight: of these losses beside the action's.
        checkpoint_every: steps between checkpoints.
        device: `cpu`, `cuda`, or `auto`: a GPU where there is one.
        model: the agent.
    """

    seeds: int = 3
    steps: int = 200
    batch: int = 6
    learning_rate: float = 2e-3
    weight_decay: float = 0.02
    size_px: int = 48
    max_steps: int = 200
    tokens: int = 80
    unknown: float = 0.1
    waypoint_weight: float = 1.0
    stop_weight: float = 0.3
    progress_weight: float = 1.0
    checkpoint_every: int = 100
    device: str = "auto"
    model: ModelConfig = field(default_factory=ModelConfig)

    def __post_init__(self) -> None:
        whole = ("seeds", "steps", "batch", "max_steps", "tokens", "checkpoint_every")
        for name in whole:
            if getattr(self, name) < 1:
                raise InputError(f"train: {name} {getattr(self, name)}; valid: 1 or more")
        stages = len(self.model.channels)
        if self.size_px < 2**stages:
            raise InputError(
                f"train: size_px {self.size_px}; valid: at least {2**stages} for {stages} channels"
            )
        for name in ("unknown",):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise InputError(f"train: {name} {getattr(self, name)}; valid: at least 0, below 1")
        if self.model.encoder not in ENCODERS:
            raise UnknownNameError("encoder", self.model.encoder, ENCODERS)
        if self.device not in ("auto", "cpu", "cuda"):
            raise UnknownNameError("device", self.device, ("auto", "cpu", "cuda"))

    def to_json(self) -> dict[str, Any]:
        """As JSON values."""
        return asdict(self)


def train_config(values: Mapping[str, Any]) -> TrainConfig:
    """Return the settings of a recipe's `train`; `model` is a mapping in it.

    Raises:
        UnknownNameError: a key, an encoder or a device that is not valid.
        InputError: a value of the wrong type or out of range.
    """
    given = dict(values)
    model = given.pop("model", {})
    if not isinstance(model, dict):
        raise InputError(f"train: model: {model!r}; valid: a mapping")
    sizes = ModelConfig(**_checked("model", ModelConfig, model))
    return TrainConfig(**_checked("train", TrainConfig, given), model=sizes)


def _checked(what: str, kind: type, given: Mapping[str, Any]) -> dict[str, Any]:
    defaults = {f.name: f.default for f in fields(kind) if f.name != "model"}
    result = {}
    for key, value in given.items():
        if key not in defaults:
            raise UnknownNameError(f"key in {what}:", str(key), defaults)
        default: Any = defaults[key]
        if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if isinstance(default, tuple) and isinstance(value, list):
            value = tuple(value)
            if not value or not all(isinstance(n, int) and n > 0 for n in value):
                raise InputError(f"{what}: {key}: {list(value)}; valid: whole numbers above 0")
        if type(value) is not type(default):
            raise InputError(f"{what}: {key}: {value!r}; valid: like {default!r}")
        result[key] = value
    return result
