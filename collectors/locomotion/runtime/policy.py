"""A trained gait at work: state and velocity command in, joint targets out, at 50 Hz."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import cast

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....formats.core.errors import FileFormatError
from ....formats.untrusted.files import read_input
from ...robots import CARD_NAME, NETWORK_NAMES, RobotHandles, RobotSpec
from .card import POLICY_FOLDER, PolicyCard, PolicyMismatchError, load_card
from .network import Mlp, Network, decode_layers
from .onnx_runtime import OnnxNetwork
from .quick import QuickStep

__all__ = ["GaitPolicy", "PolicyMismatchError"]

MAX_NETWORK_BYTES = 256 << 20


class GaitPolicy:
    """Velocity tracking for one robot in one simulation; keeps clock and last action.

    Attributes:
        robot: Robot that the policy controls.
        card: what it was trained on.
        network: turns observations into actions.
    """

    def __init__(self, robot: RobotSpec, card: PolicyCard, network: Network) -> None:
        self.robot, self.card, self.network = robot, card, network
        self._handles: tuple[mujoco.MjModel, RobotHandles] | None = None
        self._step: QuickStep | None = None

    @classmethod
    def load(cls, robot: RobotSpec, folder: Path | None = None) -> GaitPolicy:
        """Read the network and the card that `policy_files` names.

        Raises:
            FileFormatError: a file is missing or broken.
            PolicyMismatchError: trained on another model, joint order or observation layout, or
                the network is not the card's.
        """
        path, card_path = policy_files(robot, folder)
        card = load_card(card_path)
        card.check(robot, card_path)
        if not path.is_file():
            raise FileFormatError(path, "missing; it is the policy's network")
        content = read_input(path, max_bytes=MAX_NETWORK_BYTES)
        if hashlib.sha256(content).hexdigest() != card.network_sha256:
            raise PolicyMismatchError(path, f"is not the network that {card_path} describes")
        network = (
            OnnxNetwork(path, content)
            if path.suffix == ".onnx"
            else Mlp(*decode_layers(path, content))
        )
        sizes = sum(width for _, width in card.observation), len(card.joints)
        if (network.inputs, network.outputs) != sizes:
            raise PolicyMismatchError(
                path,
                f"it takes {network.inputs} numbers and gives {network.outputs}; valid: "
                f"an observation of {sizes[0]} and actions for {sizes[1]} joints",
            )
        return cls(robot, card, network)

    def changed(self, robot: RobotSpec, card: PolicyCard) -> GaitPolicy:
        """Return the same network for other facts; nothing is checked again."""
        return GaitPolicy(robot, card, self.network)

    @property
    def rate_hz(self) -> float:
        """How often `act` must be called."""
        return self.card.rate_hz

    @property
    def phase(self) -> float:
        """Gait phase in cycles, 0 while standing."""
        return float(self._step.phase[0]) if self._step else 0.0

    def reset(self) -> None:
        """Forget clock and last action; call at the start of every rollout."""
        if self._step is not None:
            self._step.reset()

    def act(self, data: mujoco.MjData, command: ArrayLike) -> NDArray[np.float64]:
        """Return joint position targets [rad] for the next 20 ms, to be written to `ctrl`.

        Args:
            data: state after a physics step; the robot may be attached under any prefix.
            command: (3,) vx, vy [m/s] and yaw rate [rad/s] in the base frame, clipped to the
                robot's limits. Nearly zero means: stand still.

        Returns:
            (J,) in the order of `robot.joint_names`.
        """
        step = self._step
        if step is None or step.data is not data:
            step = self._step = self._started(data)
        vx, vy, yaw = cast(Sequence[float], command)
        step.look(vx, vy, yaw)
        self.network.run(step.observation, self._output)
        return step.targets(self._output, self.card.action_clip, self.card.action_scale_rad)

    def _started(self, data: mujoco.MjData) -> QuickStep:
        """Return a step for another simulation, with the clock and the action of the last one."""
        card = self.card
        step = QuickStep(data, self.handles(data.model), card.gait, card.rate_hz, card.past)
        self._output = np.zeros(step.action.shape, dtype=np.float32)
        if self._step is not None:
            step.take_over(self._step)
        return step

    def infer(self, observation: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the actions (N, J) for observations (N, D) in the layout of `observation.py`.

        Stateless.
        """
        seen = np.ascontiguousarray(observation, dtype=np.float32)
        action = np.zeros((len(seen), self.network.outputs), dtype=np.float32)
        self.network.run(seen, action)
        clip = self.card.action_clip
        return np.clip(action.astype(np.float64), -clip, clip)

    def handles(self, model: mujoco.MjModel) -> RobotHandles:
        """Return the addresses of this robot in `model`, looked up once per model."""
        if self._handles is None or self._handles[0] is not model:
            self._handles = (model, RobotHandles.find(self.robot, model))
        return self._handles[1]


def policy_files(robot: RobotSpec, folder: Path | None = None) -> tuple[Path, Path]:
    """Return where a robot's network and card are: `<robot>.safetensors`, `<robot>.json`.

    Without a folder they are ours beside this package, or, for a user's own robot, those in its
    folder: `policy.onnx` or `policy.safetensors`, and `policy.json`.
    """
    if folder is None and robot.folder is not None:
        paths = [robot.folder / name for name in NETWORK_NAMES]
        return next((p for p in paths if p.is_file()), paths[0]), robot.folder / CARD_NAME
    folder = folder or POLICY_FOLDER
    return folder / f"{robot.name}.safetensors", folder / f"{robot.name}.json"
