"""Convert a trained actor to the network that replays run."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ....formats.core.arrays import Array
from ....formats.core.atomic import write_bytes
from ...robots import RobotSpec
from ..runtime.card import PolicyCard, load_card, save_card
from ..runtime.footing import Footing
from ..runtime.gait import RATE_HZ
from ..runtime.network import encode_layers
from ..runtime.observation import layout, present
from ..runtime.policy import policy_files, stairs_files
from .config import TrainingConfig
from .mirror import Symmetry
from .recipes import recipe
from .stairs.base import Base


def encode_actor(actor: Any, mirror: Symmetry | None = None) -> bytes:
    """Serialise `rsl_rl`'s actor (normaliser and ELU network); see `encode_layers`.

    With `mirror` the file holds the mean of the network and its mirror image, which is exactly
    symmetric where training only comes near: the two stand side by side in one network of twice
    the width.
    """
    return encode_layers(*_layers(actor, mirror))


def _layers(actor: Any, mirror: Symmetry | None) -> tuple[list[Array], list[Array]]:
    normalizer = actor.obs_normalizer
    std = _float64(normalizer.std) + normalizer.eps
    weights, biases = folded_layers(actor.mlp, _float64(normalizer.mean), std)
    if mirror is not None:
        weights, biases = with_mirror_image(weights, biases, mirror)
    return weights, biases


def folded_layers(
    mlp: torch.nn.Sequential, mean: Array, std: Array
) -> tuple[list[Array], list[Array]]:
    """Return weights and biases; the normalisation of the observations is in the first layer."""
    linear = [layer for layer in mlp if isinstance(layer, torch.nn.Linear)]
    weights = [_float64(layer.weight) for layer in linear]
    biases = [_float64(layer.bias) for layer in linear]
    weights[0] = weights[0] / std
    biases[0] = biases[0] - weights[0] @ mean
    return weights, biases


def _float64(values: torch.Tensor) -> Array:
    return values.detach().cpu().numpy().astype(np.float64)


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


def _matrix(order: torch.Tensor, signs: torch.Tensor) -> Array:
    """Return the matrix M of (M v)[i] = signs[i] v[order[i]]."""
    return np.eye(len(order))[order.numpy()] * signs.numpy()[:, None]


def write_policy(
    robot: RobotSpec,
    config: TrainingConfig,
    actor: torch.nn.Module,
    training: dict[str, Any],
    folder: Path,
    base: Base | None = None,
    footing: Footing | None = None,
) -> None:
    """Write a network and its card, without an evaluation yet, into `folder`.

    With a `base` they are what is added to that gait on stairs; see `stairs_files`.
    """
    blocks = layout(robot.policy_joints, base.card.past if base else 0, footing)
    if base is None:
        content = encode_actor(actor, Symmetry.of(robot))
    else:
        weights, biases = _layers(actor, Symmetry.of(robot, 0, footing))
        seen = present(blocks)
        first = np.zeros((len(weights[0]), len(seen)))
        first[:, seen] = weights[0]
        content = encode_layers([first, *weights[1:]], biases)
    speeds = (joint.speed_rad_s for joint in robot.joints)
    card = PolicyCard(
        robot=robot.name,
        physics_hash=robot.physics_hash(),
        observation=blocks,
        joints=robot.policy_joint_names,
        action_scale_rad=robot.action_scale_rad,
        action_clip=config.action_clip,
        default_joint_rad=tuple(joint.default_rad for joint in robot.joints),
        kp=tuple(joint.kp for joint in robot.joints),
        kd=tuple(joint.kd for joint in robot.joints),
        torque_nm=tuple(joint.torque_nm for joint in robot.joints),
        speed_rad_s=tuple(s if math.isfinite(s) else None for s in speeds),
        rate_hz=RATE_HZ,
        gait=base.card.gait if base else recipe(robot).gait,
        footing=footing,
        network_sha256="",
        training=training,
        evaluation={},
    )
    install(content, card, (policy_files if base is None else stairs_files)(robot, folder))


def install(content: bytes, card: PolicyCard, paths: tuple[Path, Path]) -> None:
    """Write a network's file and its card, with the network's digest."""
    path, card_path = paths
    write_bytes(path, content)
    save_card(replace(card, network_sha256=hashlib.sha256(content).hexdigest()), card_path)


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
