"""One environment over several processes, each with its share of the robots."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from multiprocessing.context import ForkProcess
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from ....formats.core.errors import VlnpeError
from .env import GaitEnv


class Workers(VecEnv):
    """`GaitEnv`s side by side, each in a process of its own.

    The processes are forked, so that they share compiled kernels; none of them uses CUDA.
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
        self._processes: list[ForkProcess] = []
        for k in range(count):
            here, there = context.Pipe()
            # A child must not hold the parent's ends, or it would outlive the parent.
            mine = (*self._pipes, here)
            process = context.Process(target=_serve, args=(build, k, there, mine), daemon=True)
            process.start()
            there.close()
            self._pipes.append(here)
            self._processes.append(process)

    def get_observations(self) -> TensorDict:
        """Return the observations of all robots; see `GaitEnv`."""
        return _joined(self._ask([("observe",)] * len(self._pipes)))

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict]:
        """Return one policy step of every simulation; see `rsl_rl.env.VecEnv.step`."""
        scales = self.push_scale, self.smoothness_scale
        parts = np.split(actions.numpy(), len(self._pipes))
        answers = self._ask([("step", part, *scales) for part in parts])
        seen, reward, done, late, age = zip(*answers, strict=True)
        self.episode_length_buf = torch.from_numpy(np.concatenate(age))
        reward, done, late = (torch.from_numpy(np.concatenate(v)) for v in (reward, done, late))
        return _joined(seen), reward, done, {"time_outs": late}

    def take_statistics(self) -> tuple[dict[str, float], NDArray[np.int64]]:
        """Return means over all workers, and the sum of their walks; see `GaitEnv`."""
        rows, walks = zip(*self._ask([("statistics",)] * len(self._pipes)), strict=True)
        return {k: float(np.mean([row[k] for row in rows])) for k in rows[0]}, np.sum(walks, axis=0)

    def close(self) -> None:
        """Stop the processes."""
        for pipe in self._pipes:
            pipe.close()
        for process in self._processes:
            process.join()

    def _ask(self, questions: Sequence[tuple[Any, ...]]) -> list[Any]:
        """Return the answers of all workers, each to its question."""
        number = 0
        try:
            for number, question in enumerate(questions):
                self._pipes[number].send(question)
            answers = []
            for number in range(len(self._pipes)):
                answers.append(self._pipes[number].recv())
        except (EOFError, OSError):
            raise VlnpeError(
                f"worker {number} of {len(self._pipes)} died; the same command goes on from the "
                "last checkpoint"
            ) from None
        return answers


def _serve(
    build: Callable[[int], GaitEnv],
    number: int,
    pipe: Connection,
    others: Sequence[Connection],
) -> None:
    for other in others:
        other.close()
    torch.set_num_threads(1)
    env = build(number)
    while True:
        try:
            kind, *values = pipe.recv()
        except EOFError:  # nobody needs it any more
            return
        if kind == "step":
            action, env.push_scale, env.smoothness_scale = values
            seen, reward, done, extras = env.step(torch.from_numpy(action))
            late = extras["time_outs"].numpy()
            age = env.episode_length_buf.numpy()
            pipe.send((_arrays(seen), reward.numpy(), done.numpy(), late, age))
        elif kind == "observe":
            pipe.send(_arrays(env.get_observations()))
        else:
            pipe.send(env.take_statistics())


def _arrays(seen: TensorDict) -> tuple[NDArray, NDArray]:
    return seen["policy"].numpy(), seen["privileged"].numpy()


def _joined(parts: Sequence[tuple[NDArray, NDArray]]) -> TensorDict:
    groups = zip(("policy", "privileged"), zip(*parts, strict=True), strict=True)
    tensors = {name: torch.from_numpy(np.concatenate(values)) for name, values in groups}
    return TensorDict(tensors, batch_size=[len(tensors["policy"])])
