"""Batches of a mixture: in the same order for any number of workers, resumable between any two."""

import os
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import torch
from torch.utils.data import BatchSampler, DataLoader, Dataset, default_collate

from ...formats.core.errors import InputError
from .sampler import MixtureSampler

Collate = Callable[[list[Any]], Any]


class JoinedSources(Dataset[Any]):
    """Items of several loaders by (source, item); each item also says its `source`."""

    def __init__(self, sources: Sequence[Dataset[Any]]):
        """Join map-style `sources`."""
        self.sources = list(sources)

    def __getitem__(self, pair: tuple[int, int]) -> Any:
        """Return the item of a source."""
        source, item = pair
        return {**self.sources[source][item], "source": source}


class MixtureLoader:
    """Iterate over batches; each pass is one epoch and continues the sequence of draws.

    `state_dict` holds how many batches the caller has had, whatever workers have fetched ahead;
    with `load_state_dict` a new loader yields the very next one.

    Args:
        sources: loaders in the order of the sampler's sources, with items of common keys.
        sampler: whose draws make the batches.
        batch_size: draws per batch; the last of an epoch may be smaller.
        workers: processes that read and decode; 0 does it in this one.
        collate: makes a batch of items, e.g. `collate_sequences`.
    """

    def __init__(
        self,
        sources: Sequence[Dataset[Any]],
        sampler: MixtureSampler,
        batch_size: int,
        workers: int = 0,
        collate: Collate = default_collate,
    ):
        """Set up the loader.

        Raises:
            InputError: sizes that do not belong together, or a batch without items.
        """
        sizes = [len(source) for source in sources]  # type: ignore[arg-type]
        if sizes != sampler.sizes:
            raise InputError(f"the loaders have {sizes} items; the sampler expects {sampler.sizes}")
        if batch_size < 1 or workers < 0:
            raise InputError(
                f"batch size {batch_size}, workers {workers}; valid: at least 1 and at least 0"
            )
        self._data = JoinedSources(sources)
        self._sampler, self._batch_size = sampler, batch_size
        self._workers, self._collate = workers, collate
        self._given = sampler.drawn  # draws in the batches that the caller has had

    def __len__(self) -> int:
        """Return the number of batches left in this epoch."""
        left = self._sampler.length - self._given % self._sampler.length
        return -(-left // self._batch_size)

    def __iter__(self) -> Iterator[Any]:
        """Iterate over the rest of the epoch."""
        self._sampler.drawn = self._given
        stop = (self._given // self._sampler.length + 1) * self._sampler.length
        options: dict[str, Any] = {}
        if self._workers:
            # Decoders and threads do not survive a fork.
            options = {"multiprocessing_context": "spawn", "worker_init_fn": _one_thread}
        batches = DataLoader(
            self._data,  # type: ignore[arg-type]  # its indices are pairs
            batch_sampler=BatchSampler(
                self._sampler,  # type: ignore[arg-type]
                self._batch_size,
                drop_last=False,
            ),
            num_workers=self._workers,
            collate_fn=self._collate,
            generator=torch.Generator(),  # else it would draw from the caller's
            **options,
        )
        for batch in batches:
            self._given = min(self._given + self._batch_size, stop)
            yield batch

    def state_dict(self) -> dict[str, Any]:
        """Return the caller's position as JSON values."""
        return {**self._sampler.state_dict(), "drawn": self._given}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue after the batch at which `state` was taken.

        Raises:
            InputError: it was taken of another mixture.
        """
        self._sampler.load_state_dict(state)
        self._given = self._sampler.drawn


def _one_thread(_worker: int) -> None:
    os.environ["OMP_NUM_THREADS"] = "1"
    torch.set_num_threads(1)
