"""Image encoders: small convolutional ones, or torchvision's with weights from a file."""

from pathlib import Path
from pickle import UnpicklingError
from typing import Self

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn

from ...formats.core.errors import FileFormatError
from ..config import TIMM, ModelConfig

# Mean and spread of the images that torchvision's networks were trained on.
_MEAN, _STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
# What reading a file raises that has no weights of this network.
DAMAGED = (OSError, RuntimeError, ValueError, KeyError, UnpicklingError, SafetensorError)


class CompactEncoder(nn.Module):
    """Convolutions of stride 2; (N, C_in, H, W) to (N, C, H / 2^stages, W / 2^stages)."""

    def __init__(self, inputs: int, channels: tuple[int, ...]):
        """Build it for images of `inputs` channels."""
        super().__init__()
        stages: list[nn.Module] = []
        for here in channels:
            stages += [
                nn.Conv2d(inputs, here, 3, stride=2, padding=1),
                nn.GroupNorm(4 if here % 4 == 0 else 1, here),
                nn.ReLU(inplace=True),
            ]
            inputs = here
        self.stages = nn.Sequential(*stages)
        self.features = inputs

    def forward(self, images: Tensor) -> Tensor:
        """Return the map of features."""
        return self.stages(images)


class TorchvisionEncoder(nn.Module):
    """A ResNet without its last layers; (N, 3, H, W) in 0 … 1 to (N, C, H / 32, W / 32)."""

    def __init__(self, config: ModelConfig, *, pretrained: bool = True):
        """Build it; without `pretrained`, its weights will be loaded with a checkpoint's.

        Raises:
            FileFormatError: its weights are missing or of another network.
        """
        super().__init__()
        from torchvision.models import get_model

        network = get_model(config.encoder, weights=None)
        if config.encoder_weights and pretrained:
            path = Path(config.encoder_weights)
            try:
                network.load_state_dict(read_weights(path))
            except DAMAGED as error:
                raise FileFormatError(
                    path, f"not weights of {config.encoder}: {str(error).splitlines()[0]}"
                ) from error
        self.features = {"resnet50": 2048}.get(config.encoder, 512)
        self.stages = nn.Sequential(*list(network.children())[:-2])
        self._frozen = not config.train_encoder
        self.stages.requires_grad_(config.train_encoder)

    def train(self, mode: bool = True) -> Self:
        """Keep frozen stages in evaluation mode, or their batch normalisation would be updated."""
        super().train(mode)
        if self._frozen:
            self.stages.eval()
        return self

    def forward(self, images: Tensor) -> Tensor:
        """Return the map of features."""
        mean, std = (images.new_tensor(v)[:, None, None] for v in (_MEAN, _STD))
        return self.stages((images - mean) / std)


class Adapter(nn.Module):
    """A layer on the features of a pretrained encoder; (N, C_in, 4, 4) to (N, C, 4, 4)."""

    def __init__(self, config: ModelConfig):
        """Build it for features of `encoder_width`."""
        super().__init__()
        self.features = config.channels[-1]
        self.layer = nn.Sequential(
            nn.Conv2d(config.encoder_width, self.features, 1), nn.ReLU(inplace=True)
        )

    def forward(self, features: Tensor) -> Tensor:
        """Return the map of features."""
        return self.layer(features)


def rgb_encoder(
    config: ModelConfig, *, pretrained: bool = True
) -> CompactEncoder | TorchvisionEncoder | Adapter:
    """Return the encoder of RGB images that the configuration names."""
    if config.encoder.startswith(TIMM):
        return Adapter(config)
    if config.encoder == "compact":
        return CompactEncoder(3, config.channels)
    return TorchvisionEncoder(config, pretrained=pretrained)


def read_weights(path: Path) -> dict[str, Tensor]:
    """Return a state dict; `DAMAGED` are the errors of a file that has none."""
    if path.suffix == ".safetensors":
        return load_file(path)
    return torch.load(path, weights_only=True, map_location="cpu")
