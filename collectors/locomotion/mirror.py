"""Left-right mirroring of observations and actions of a symmetric legged robot."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from tensordict import TensorDict

from ..robots import RobotSpec
from .observation import layout

# Signs of the vector blocks under a reflection of y; rates are axial vectors.
_BLOCK_SIGNS = {
    "linear_velocity_base_m_s": (1, -1, 1),
    "angular_velocity_base_rad_s": (-1, 1, -1),
    "gravity_base": (1, -1, 1),
    "command_vx_vy_yaw": (1, -1, -1),
    # The other legs lead by half a cycle.
    "gait_phase_sin_cos": (-1, -1),
}


def mirror_joints(robot: RobotSpec) -> tuple[list[int], list[int]]:
    """Permutation and signs that mirror joint vectors, by the names' left and right marks."""
    names = list(robot.joint_names)
    swap = {"FL": "FR", "FR": "FL", "RL": "RR", "RR": "RL"}
    order = [names.index(swap[name[:2]] + name[2:]) for name in names]
    return order, [-1 if "_hip_" in name else 1 for name in names]


def mirror_observation(robot: RobotSpec) -> tuple[list[int], list[int]]:
    """Permutation and signs that mirror whole observations."""
    order: list[int] = []
    signs: list[int] = []
    joint_order, joint_signs = mirror_joints(robot)
    for name, width in layout(len(robot.joints)):
        start = len(order)
        if name in _BLOCK_SIGNS:
            order += range(start, start + width)
            signs += _BLOCK_SIGNS[name]
        else:
            order += [start + i for i in joint_order]
            signs += joint_signs
    return order, signs


def mirrored(
    env: Any, obs: TensorDict | None, actions: torch.Tensor | None
) -> tuple[TensorDict | None, torch.Tensor | None]:
    """Append the mirror images to a batch, as `rsl_rl`'s symmetry extension asks.

    The critic's privileged group is repeated unmirrored: only the actor's mirror loss uses this.
    """
    if obs is not None:
        order, signs = _tensors(*mirror_observation(env.robot))
        both = obs["policy"]
        obs = TensorDict(
            {
                "policy": torch.cat([both, both[:, order] * signs]),
                "privileged": obs["privileged"].repeat(2, 1),
            },
            batch_size=[2 * len(both)],
        )
    if actions is not None:
        order, signs = _tensors(*mirror_joints(env.robot))
        actions = torch.cat([actions, actions[:, order] * signs])
    return obs, actions


def _tensors(order: list[int], signs: list[int]) -> tuple[torch.Tensor, torch.Tensor]:
    return torch.tensor(order), torch.tensor(np.asarray(signs, dtype=np.float32))
