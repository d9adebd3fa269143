"""Convert a trained actor to the network that replays run, and back for a refinement."""

import hashlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ....formats.core.atomic import atomic_file
from ...robots import RobotSpec
from ..runtime.card import PolicyCard, load_card, save_card
from ..runtime.gait import RATE_HZ
from ..runtime.network import decode_layers, encode_layers
from ..runtime.observation import layout
from ..runtime.policy import policy_files
from .config import TrainingConfig
from .env import GaitEnv
from .gaits import GAITS
from .mirror import Symmetry

Array = NDArray[np.float64]
LOOK_STEPS = 200  # policy steps over which the observations' mean and spread are taken


def encode_actor(actor: torch.nn.Module, mirror: Symmetry | None = None) -> bytes:
    """Serialise `rsl_rl`'s actor (normaliser and ELU network); see `encode_layers`.

    The observation normalisation is folded into the first layer, so that the file needs nothing
    beside it. With `mirror` the file holds the mean of the network and its mirror image, which is
    exactly symmetric where training only comes near: the two stand side by side in one network of
    twice the width.
    """
    linear = [layer for layer in actor.mlp if isinstance(layer, torch.nn.Linear)]  # type: ignore[attr-defined]
    normalizer = actor.obs_normalizer
    mean = normalizer.mean.numpy().astype(np.float64)  # type: ignore[operator, union-attr]
    std = normalizer.std.numpy().astype(np.float64) + normalizer.eps  # type: ignore[operator, union-attr]
    weights = [layer.weight.detach().numpy().astype(np.float64) for layer in linear]
    biases = [layer.bias.detach().numpy().astype(np.float64) for layer in linear]
    weights[0] = weights[0] / std
    biases[0] = biases[0] - weights[0] @ mean
    if mirror is not None:
        weights, biases = with_mirror_image(weights, biases, mirror)
    return encode_layers(weights, biases)


def with_mirror_image(
    weights: Sequence[Array], biases: Sequence[Array], mirror: Symmetry
) -> tuple[list[Array], list[Array]]:
    """Return the layers of (π(o) + M π(M o)) / 2, from those of π.

    M mirrors observations and actions.
    """
    seen = _matrix(mirror.observation_order, mirror.observation_signs)
    done = _matrix(mirror.joint_order, mirror.joint_signs)
    first, *middle, last = weights
    halves = [np.vstack([first, first @ seen])]
    halves += [np.kron(np.eye(2), weight) for weight in middle]
    halves.append(0.5 * np.hstack([last, done @ last]))
    joined = [np.tile(bias, 2) for bias in biases[:-1]]
    weights = [half.astype(np.float64) for half in halves]
    return weights, [*joined, 0.5 * (biases[-1] + done @ biases[-1])]


def layers_of(robot: RobotSpec, folder: Path | None = None) -> tuple[list[Array], list[Array]]:
    """Return the weights and biases of the gait in a folder, float64; default the installed one."""
    path = policy_files(robot, folder)[0]
    weights, biases = decode_layers(path, path.read_bytes())
    return [w.astype(np.float64) for w in weights], [b.astype(np.float64) for b in biases]


def _matrix(order: torch.Tensor, signs: torch.Tensor) -> Array:
    """Return the matrix M of (M v)[i] = signs[i] v[order[i]]."""
    return np.eye(len(order))[order.numpy()] * signs.numpy()[:, None]


def motor_speeds(robot: RobotSpec) -> tuple[float | None, ...]:
    """Return the maximum speed of each joint's motor [rad/s], as listed on the card."""
    speeds = (joint.speed_rad_s for joint in robot.joints)
    return tuple(speed if math.isfinite(speed) else None for speed in speeds)


def write_policy(
    robot: RobotSpec,
    config: TrainingConfig,
    actor: torch.nn.Module,
    training: dict[str, Any],
    folder: Path,
) -> None:
    """Write `<robot>.safetensors` and `<robot>.json` (without an evaluation yet) into `folder`."""
    content = encode_actor(actor, Symmetry.of(robot))
    card = PolicyCard(
        robot=robot.name,
        physics_hash=robot.physics_hash(),
        observation=layout(robot.policy_joints),
        joints=robot.policy_joint_names,
        action_scale_rad=robot.action_scale_rad,
        action_clip=config.action_clip,
        default_joint_rad=tuple(joint.default_rad for joint in robot.joints),
        kp=tuple(joint.kp for joint in robot.joints),
        kd=tuple(joint.kd for joint in robot.joints),
        torque_nm=tuple(joint.torque_nm for joint in robot.joints),
        speed_rad_s=motor_speeds(robot),
        rate_hz=RATE_HZ,
        gait=GAITS[robot.name],
        network_sha256=hashlib.sha256(content).hexdigest(),
        training=training,
        evaluation={},
    )
    path, card_path = policy_files(robot, folder)
    with atomic_file(path) as temporary:
        temporary.write_bytes(content)
    save_card(card, card_path)


def plain_card(robot: RobotSpec, folder: Path) -> PolicyCard:
    """Return the card of the gait in a folder, to train on from it.

    Raises:
        SystemExit: it anticipates delays; what it was made of cannot be taken apart again.
    """
    card = load_card(policy_files(robot, folder)[1])
    if card.past:
        raise SystemExit(
            f"{folder}: {robot.name}'s gait there anticipates delays already; start from the one "
            "that it was made from (docs/results/gaits.md, Acting ahead of a delay)"
        )
    return card


def start_from(robot: RobotSpec, folder: Path, env: GaitEnv, actor: Any) -> None:
    """Give a fresh actor the weights of `<robot>.safetensors`, undoing what `export.py` folded in.

    An exported network is the mean of an actor and its mirror image side by side: its first half
    is the actor. What the export folded into the first layer, the observations' normalisation, is
    taken from a walk of the environment under that network and then factored out again.

    Args:
        robot: whose gait.
        folder: of the gait.
        env: walked for 4 s.
        actor: `rsl_rl`'s, with a normaliser and an ELU network of half the exported widths.
    """
    plain_card(robot, folder)
    weights, biases = layers_of(robot, folder)
    linear = [layer for layer in actor.mlp if isinstance(layer, torch.nn.Linear)]
    for i, layer in enumerate(linear):
        rows, columns = layer.weight.shape
        last = i == len(linear) - 1
        weights[i] = weights[i][:rows, :columns] * (2.0 if last else 1.0)
        biases[i] = biases[i][:rows]
    seen = _walk(env, weights, biases)
    normalizer = actor.obs_normalizer
    normalizer._mean[:] = torch.from_numpy(seen.mean(axis=0)).float()
    normalizer._var[:] = torch.from_numpy(seen.var(axis=0)).float()
    normalizer._std[:] = torch.sqrt(normalizer._var)
    # So much seen that a training's first steps do not move it from under the weights.
    normalizer.count.fill_(len(seen))
    biases[0] = biases[0] + weights[0] @ normalizer.mean.double().numpy()
    weights[0] = weights[0] * (normalizer.std.double().numpy() + normalizer.eps)
    with torch.no_grad():
        for layer, weight, bias in zip(linear, weights, biases, strict=True):
            layer.weight[:] = torch.from_numpy(weight).float()
            layer.bias[:] = torch.from_numpy(bias).float()


def _walk(env: GaitEnv, weights: list[np.ndarray], biases: list[np.ndarray]) -> np.ndarray:
    """Return the observations (K, D) of a walk of all simulations under a plain network."""
    seen = []
    for _ in range(LOOK_STEPS):
        observation = env.get_observations()["policy"].numpy().astype(np.float64)
        seen.append(observation)
        value = observation
        for i, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
            value = value @ weight.T + bias
            if i < len(weights) - 1:
                value = np.where(value > 0, value, np.expm1(np.minimum(value, 0.0)))
        env.step(torch.from_numpy(value.astype(np.float32)))
    env.statistics.clear()
    return np.concatenate(seen)
