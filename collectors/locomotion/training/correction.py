"""A network beside a gait's that adds to its actions, and both as one."""

import numpy as np
import torch

from ....formats.core.arrays import F32, Array
from ...robots import RobotSpec
from ..runtime.network import Network
from .export import folded_layers, with_mirror_image
from .mirror import Symmetry

Samples = F32

PAST = 5  # steps of 20 ms that the network sees beyond the last
HIDDEN = 128


class Correction(torch.nn.Module):
    """Addition to a gait's actions: a symmetric network whose output is zero at first."""

    def __init__(self, robot: RobotSpec) -> None:
        """Build the network for a robot's observations with `PAST` steps."""
        super().__init__()
        self.symmetry = Symmetry.of(robot, PAST)
        inputs, outputs = len(self.symmetry.observation_order), robot.policy_joints
        self.mlp = torch.nn.Sequential(
            torch.nn.Linear(inputs, HIDDEN),
            torch.nn.ELU(),
            torch.nn.Linear(HIDDEN, HIDDEN),
            torch.nn.ELU(),
            torch.nn.Linear(HIDDEN, outputs),
        )
        for parameter in self.mlp[-1].parameters():
            torch.nn.init.zeros_(parameter)
        self.mean, self.std = (
            torch.nn.Parameter(start(inputs), requires_grad=False)
            for start in (torch.zeros, torch.ones)
        )

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        """Return the mean of the network and its mirror image, (N, P) for observations (N, D)."""
        mirror = self.symmetry
        image = seen[:, mirror.observation_order] * mirror.observation_signs
        both = (torch.cat([seen, image]) - self.mean) / self.std
        direct, other = self.mlp(both).chunk(2)
        return 0.5 * (direct + other[:, mirror.joint_order] * mirror.joint_signs)

    def layers(self) -> tuple[list[Array], list[Array]]:
        """Return weights and biases of the same as a plain network."""
        mean, std = (values.numpy().astype(np.float64) for values in (self.mean, self.std))
        return with_mirror_image(*folded_layers(self.mlp, mean, std), self.symmetry)


class Corrected:
    """A gait's network with a correction beside it; keeps what they saw and answered.

    Attributes:
        seen, done: observations (N, D) and actions (N, P) of each step.
    """

    def __init__(self, gait: Network, correction: Correction) -> None:
        self.gait, self.correction = gait, correction
        self.inputs, self.outputs = len(correction.symmetry.observation_order), gait.outputs
        self.seen: list[Samples] = []
        self.done: list[Samples] = []

    def run(self, observation: Samples, action: Samples) -> None:
        """Fill `action` (N, P) from `observation` (N, D)."""
        self.gait.run(np.ascontiguousarray(observation[:, : self.gait.inputs]), action)
        with torch.no_grad():
            action += self.correction(torch.from_numpy(observation)).numpy()
        self.seen.append(observation.copy())
        self.done.append(action.copy())


def beside(
    gait: tuple[list[Array], list[Array]], correction: tuple[list[Array], list[Array]]
) -> tuple[list[Array], list[Array]]:
    """Return the layers of the sum of two networks, of which the first sees less."""
    (own, *_, own_last), (other, *_, other_last) = gait[0], correction[0]
    inputs = other.shape[1] - own.shape[1]
    weights = [np.vstack([np.pad(own, ((0, 0), (0, inputs))), other])]
    for a, b in zip(gait[0][1:-1], correction[0][1:-1], strict=True):
        weights.append(
            np.block([[a, np.zeros((len(a), b.shape[1]))], [np.zeros((len(b), a.shape[1])), b]])
        )
    weights.append(np.hstack([own_last, other_last]))
    hidden = [np.concatenate(pair) for pair in zip(gait[1][:-1], correction[1][:-1], strict=True)]
    return weights, [*hidden, gait[1][-1] + correction[1][-1]]
