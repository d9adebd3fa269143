"""One environment over several processes, each with its share of the robots."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from .env import GaitEnv


class Workers(VecEnv):
    """`GaitEnv`s side by side, each in a process of its own.

    They are forked, so that they share compiled kernels; call it before CUDA is used.
    """

    def __init__(self, first: GaitEnv, build: Callable[[int], GaitEnv], count: int) -> None:
        """Start the processes.

        Args:
            first: one of the environments, for what all have in common.
            build: returns the environment of a worker by its number.
            count: of workers.
        """
        self.first = first
        self.num_envs, self.num_actions = count * first.num_envs, first.num_actions
        self.cfg, self.device = first.cfg, first.device
        self.max_episode_length = first.max_episode_length
        self.episode_length_buf = torch.zeros(self.num_envs, dtype=torch.long)
        self.symmetry, self.footing = first.symmetry, first.footing
        self.push_scale = self.smoothness_scale = 1.0
        context = multiprocessing.get_context("fork")
        self._pipes: list[Connection] = []
        for k in range(count):
            here, there = context.Pipe()
            context.Process(target=_serve, args=(build, k, there), daemon=True).start()
            self._pipes.append(here)

    def get_observations(self) -> TensorDict:
        """Return the observations of all robots; see `GaitEnv`."""
        return _joined(self._ask(("observe",)))

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict]:
        """Return one policy step of every simulation; see `rsl_rl.env.VecEnv.step`."""
        parts = np.split(actions.numpy(), len(self._pipes))
        scales = self.push_scale, self.smoothness_scale
        for pipe, part in zip(self._pipes, parts, strict=True):
            pipe.send(("step", part, *scales))
        seen, reward, done, late, age = zip(*(pipe.recv() for pipe in self._pipes), strict=True)
        self.episode_length_buf = torch.from_numpy(np.concatenate(age))
        reward, done, late = (torch.from_numpy(np.concatenate(v)) for v in (reward, done, late))
        return _joined(seen), reward, done, {"time_outs": late}

    def take_statistics(self) -> tuple[dict[str, float], NDArray[np.int64]]:
        """Return means over all workers, and the sum of their walks; see `GaitEnv`."""
        rows, walks = zip(*self._ask(("news",)), strict=True)
        return {k: float(np.mean([row[k] for row in rows])) for k in rows[0]}, np.sum(walks, axis=0)

    def close(self) -> None:
        """Stop the processes."""
        for pipe in self._pipes:
            pipe.send(("stop",))

    def _ask(self, question: tuple[Any, ...]) -> list[Any]:
        for pipe in self._pipes:
            pipe.send(question)
        return [pipe.recv() for pipe in self._pipes]


def _serve(build: Callable[[int], GaitEnv], number: int, pipe: Connection) -> None:
    torch.set_num_threads(1)
    env = build(number)
    while True:
        kind, *values = pipe.recv()
        if kind == "step":
            action, env.push_scale, env.smoothness_scale = values
            seen, reward, done, extras = env.step(torch.from_numpy(action))
            late = extras["time_outs"].numpy()
            age = env.episode_length_buf.numpy()
            pipe.send((_arrays(seen), reward.numpy(), done.numpy(), late, age))
        elif kind == "observe":
            pipe.send(_arrays(env.get_observations()))
        elif kind == "news":
            pipe.send(env.take_statistics())
        else:
            return


def _arrays(seen: TensorDict) -> tuple[NDArray, NDArray]:
    return seen["policy"].numpy(), seen["privileged"].numpy()


def _joined(parts: Sequence[tuple[NDArray, NDArray]]) -> TensorDict:
    groups = zip(("policy", "privileged"), zip(*parts, strict=True), strict=True)
    tensors = {name: torch.from_numpy(np.concatenate(values)) for name, values in groups}
    return TensorDict(tensors, batch_size=[len(tensors["policy"])])
