"""A finished gait under one in training: the new network learns what to add to its actions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from .....formats.core.arrays import Array
from ....robots import RobotSpec
from ...runtime.card import PolicyCard
from ...runtime.network import decode_layers
from ...runtime.policy import GaitPolicy, policy_files


@dataclass(frozen=True)
class Base:
    """A gait to build on.

    Attributes:
        card: its card.
        layers: weights and biases of its network.
    """

    card: PolicyCard
    layers: tuple[list[Array], list[Array]]

    @classmethod
    def load(cls, robot: RobotSpec, folder: Path | None = None) -> Base:
        """Read the gait in a folder, by default the installed one.

        Raises:
            FileFormatError: there is none, or it does not fit the robot.
        """
        return cls(GaitPolicy.load(robot, folder).card, layers_of(robot, folder))

    @cached_property
    def _tensors(self) -> list[tuple[torch.Tensor, torch.Tensor]]:
        pairs = zip(*self.layers, strict=True)
        return [(torch.from_numpy(a).float(), torch.from_numpy(b).float()) for a, b in pairs]

    def act(self, observation: Array) -> NDArray[np.float32]:
        """Return its actions (N, P) for observations (N, D) that begin with its own."""
        inputs = self._tensors[0][0].shape[1]
        with torch.inference_mode():
            x = torch.from_numpy(observation[:, :inputs].astype(np.float32))
            for k, (weight, bias) in enumerate(self._tensors):
                x = torch.nn.functional.linear(torch.nn.functional.elu(x) if k else x, weight, bias)
        return x.numpy()


def layers_of(robot: RobotSpec, folder: Path | None = None) -> tuple[list[Array], list[Array]]:
    """Return the weights and biases of the gait in a folder, float64; default the installed one."""
    path = policy_files(robot, folder)[0]
    weights, biases = decode_layers(path, path.read_bytes())
    return [w.astype(np.float64) for w in weights], [b.astype(np.float64) for b in biases]
