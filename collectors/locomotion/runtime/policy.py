"""A trained gait at work: state and velocity command in, joint targets out, at 50 Hz."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....formats.core.arrays import Array
from ....formats.core.errors import FileFormatError
from ....formats.untrusted.files import read_input
from ...physics.ground import Ground
from ...robots import CARD_NAME, NETWORK_NAMES, RobotHandles, RobotSpec
from .card import POLICY_FOLDER, PolicyCard, PolicyMismatchError, load_card
from .estimator import StateEstimator
from .network import Mlp, Network, decode_layers
from .onnx_runtime import OnnxNetwork
from .sensors import SensorErrors, Sensors, Simulation
from .step import GaitStep

__all__ = ["GaitPolicy", "PolicyMismatchError"]

MAX_NETWORK_BYTES = 256 << 20


class GaitPolicy:
    """Velocity tracking for one robot in one simulation; keeps clock and last action.

    Attributes:
        robot: Robot that the policy controls.
        card: what it was trained on.
        network: turns observations into actions.
        estimates: whether trials let it estimate the state from sensors; `reset` decides in a
            replay.
        stairs: what it learned on stairs: its network, which sees the ground, adds to the actions
            wherever that is uneven (`GaitStep.uneven`); None for a gait without it.
        ground: what its footing sees in a replay; level when None.
    """

    def __init__(
        self,
        robot: RobotSpec,
        card: PolicyCard,
        network: Network,
        estimates: bool = False,
        stairs: GaitPolicy | None = None,
        ground: Ground | None = None,
    ) -> None:
        self.robot, self.card, self.network, self.estimates = robot, card, network, estimates
        self.stairs, self.ground = stairs, ground
        self._seed: int | None = None
        self._data: mujoco.MjData | None = None
        self._step: GaitStep | None = None

    @classmethod
    def load(cls, robot: RobotSpec, folder: Path | None = None) -> GaitPolicy:
        """Read the network and the card that `policy_files` names, and those for stairs if any.

        Raises:
            FileFormatError: a file is missing or broken.
            PolicyMismatchError: trained on another model, joint order or observation layout, or
                the network is not the card's, or what was learned on stairs belongs to another
                gait.
        """
        policy = cls._read(robot, *policy_files(robot, folder))
        installed = stairs_files(robot, folder)[1].is_file()
        return policy.with_stairs(folder) if installed else policy

    def with_stairs(self, folder: Path | None = None) -> GaitPolicy:
        """Return this gait with what it learned on stairs, in the files of `stairs_files`.

        Raises:
            FileFormatError: a file is missing or broken.
            PolicyMismatchError: it was learned on top of another gait, or does not see the ground.
        """
        path, card_path = stairs_files(self.robot, folder)
        stairs = self._read(self.robot, path, card_path)
        if stairs.card.training.get("base") != self.card.network_sha256:
            raise PolicyMismatchError(card_path, "was trained on top of another gait")
        for what in ("gait", "footing", "past", "action_clip"):
            if getattr(stairs.card, what) != getattr(self.card, what):
                raise PolicyMismatchError(card_path, f"its {what} is not that of the level gait")
        if self.card.sees_ground or not stairs.card.sees_ground:
            raise PolicyMismatchError(
                card_path,
                "valid: a height scan in its observation, and none in the level one's",
            )
        return GaitPolicy(self.robot, self.card, self.network, self.estimates, stairs, self.ground)

    @classmethod
    def _read(cls, robot: RobotSpec, path: Path, card_path: Path) -> GaitPolicy:
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
        """Return the same networks for other facts; nothing is checked again."""
        return GaitPolicy(robot, card, self.network, self.estimates, self.stairs, self.ground)

    def estimating(self) -> GaitPolicy:
        """Return the same gait for trials in which it estimates the state from sensors."""
        return GaitPolicy(self.robot, self.card, self.network, True, self.stairs, self.ground)

    def over(self, ground: Ground | None) -> GaitPolicy:
        """Return the same gait for replays in which its footing, if it has one, sees `ground`."""
        return GaitPolicy(self.robot, self.card, self.network, self.estimates, self.stairs, ground)

    @property
    def phase(self) -> float:
        """Gait phase in cycles, 0 while standing."""
        return float(self._step.clock.phase[0]) if self._step else 0.0

    @property
    def memory(self) -> tuple[NDArray[Any], ...]:
        """Clock, last action, past, sensors and estimate; empty before the first step."""
        return self._step.memory if self._step else ()

    def reset(self, seed: int | None = None) -> None:
        """Forget clock, last action and state; call at the start of every rollout.

        Args:
            seed: of the errors of the sensors from which the state is estimated; the true state is
                seen when None.
        """
        if (seed is None) != (self._seed is None):
            self._step = None
        self._seed = seed
        if self._step is not None:
            self._step.reset()
            self._step.reseed(seed or 0)

    def act(self, data: mujoco.MjData, command: ArrayLike) -> Array:
        """Return joint position targets [rad] for the next 20 ms, to be written to `ctrl`.

        Args:
            data: state after a physics step; the robot may be attached under any prefix.
            command: (3,) vx, vy [m/s] and yaw rate [rad/s] in the base frame, clipped to the
                robot's limits. Nearly zero means: stand still.

        Returns:
            (J,) in the order of `robot.joint_names`.
        """
        step = self._step
        if step is None or self._data is not data:
            step = self._start(data)
        self.run(step, command, self._output)
        return step.targets(self._output, self.card.action_clip)[0]

    def run(self, step: GaitStep, command: ArrayLike, output: NDArray[np.float32]) -> None:
        """Advance a step of `steps` under commands (N, 3); fill `output` (N, P) with actions."""
        seen = step.observe(command)
        if self.stairs is None:
            self.network.run(seen, output)
            return
        self.network.run(np.ascontiguousarray(seen[:, : self.network.inputs]), output)
        uneven = np.flatnonzero(step.uneven)
        if len(uneven):
            there = np.empty((len(uneven), output.shape[1]), dtype=np.float32)
            self.stairs.network.run(seen[uneven], there)
            output[uneven] += there

    def _start(self, data: mujoco.MjData) -> GaitStep:
        """Return a step for another simulation, with the clock and the action of the last one."""
        handles = RobotHandles.find(self.robot, data.model)
        memory = (data.qpos, data.qvel, data.sensordata, data.actuator_force)
        simulation = Simulation(*(array[None] for array in memory))
        step = self.steps(simulation, data.model, handles, self._seed, self.ground)
        self._output = np.zeros(step.action.shape, dtype=np.float32)
        if self._step is not None:
            step.continue_from(self._step)
        self._data, self._step = data, step
        return step

    def steps(
        self,
        simulation: Simulation,
        model: mujoco.MjModel,
        handles: RobotHandles,
        seed: int | None,
        ground: Ground | None = None,
    ) -> GaitStep:
        """Return the step of N robots in one simulation.

        Args:
            seed: see `reset`.
            ground: what a footing sees; level when None.

        Raises:
            InputError: no state can be estimated of such legs; see `Legs.of`.
        """
        card, sensed = self.card, None
        sees_ground = (self.stairs or self).card.sees_ground
        if seed is not None:
            sensors = Sensors(simulation, handles, SensorErrors(), seed)
            sensed = sensors, StateEstimator(model, handles, len(simulation.qpos))
        return GaitStep(
            simulation.qpos,
            simulation.qvel,
            handles,
            card.gait,
            self.robot.command_limits,
            past=card.past,
            sensed=sensed,
            footing=card.footing if sees_ground or ground is not None else None,
            ground=ground,
            sees_ground=sees_ground,
        )

    def infer(self, observation: Array) -> Array:
        """Return the actions (N, J) for observations (N, D) in the layout of `observation.py`.

        Stateless.
        """
        seen = np.ascontiguousarray(observation, dtype=np.float32)
        action = np.zeros((len(seen), self.network.outputs), dtype=np.float32)
        self.network.run(seen, action)
        clip = self.card.action_clip
        return np.clip(action.astype(np.float64), -clip, clip)


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


def stairs_files(robot: RobotSpec, folder: Path | None = None) -> tuple[Path, Path]:
    """Return where what a gait learned on stairs may be, beside `policy_files`."""
    network, card = policy_files(robot, folder)
    return network.with_stem(f"{network.stem}-stairs"), card.with_stem(f"{card.stem}-stairs")


def climbs(robot: RobotSpec) -> bool:
    """Return whether a robot can take stairs: its gait has a footing, or it is only placed.

    Raises:
        FileFormatError: its gait's card is missing or broken.
    """
    if robot.drive is not None or not robot.joints:
        return robot.drive is None
    return load_card(policy_files(robot)[1]).footing is not None
