"""The order of draws from several sources: a function of seed and position alone.

Draw k belongs to the source in whose share the k-th point of a golden-ratio sequence falls, so
that shares hold within a few draws, at once and not only on average. Within a source items come in
a shuffled order, each once before any comes again; the shuffle is a keyed permutation computed
item by item, so memory does not grow with the number of items, and going on from the middle costs
nothing.

Several processes each take a golden-ratio sequence of their own, shifted evenly against each
other: so shares hold for each process within a few draws, and for all of them together.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...formats.core.errors import InputError

_GOLDEN = (5**0.5 - 1) / 2
_BLOCK = 4096
_ROUNDS = 4
_STATE_VERSION = 2


class MixtureSampler:
    """Yields (source, item) pairs, `length` per epoch; each epoch goes on in the sequence.

    It runs in the process that asks for batches, and workers only fetch what it names: their
    number changes nothing. `world` processes take draws in turn, the one with `rank` its own.

    Args:
        sizes: items of each source.
        shares: share of the draws of each source; need not sum to 1.
        seed: seed of order and shuffles.
        length: draws per epoch and process; by default all items together, divided by `world`.
        rank, world: number of this process, and of all processes.
        content: what the items are (`MixturePlan.digest`), so that a saved state is refused where
            they have changed; sizes alone would not show it.
    """

    def __init__(
        self,
        sizes: Sequence[int],
        shares: Sequence[float] | NDArray[np.float64],
        seed: int = 0,
        length: int | None = None,
        rank: int = 0,
        world: int = 1,
        content: str = "",
    ):
        """Begin at the first draw.

        Raises:
            InputError: no source, an empty one, a share that is not above 0, or a wrong rank.
        """
        given = np.asarray(shares, np.float64)
        if not sizes or min(sizes) < 1 or len(given) != len(sizes) or not (given > 0).all():
            raise InputError(
                f"sizes {list(sizes)}, shares {given.tolist()}; valid: as many shares as sizes, "
                "all above 0"
            )
        if not 0 <= rank < world:
            raise InputError(f"rank {rank} of {world}; valid: 0 … {world - 1}")
        self.sizes = [int(n) for n in sizes]
        self.shares = given / given.sum()
        self.seed, self.rank, self.world, self.content = seed, rank, world, content
        self.length = max(sum(self.sizes) // world, 1) if length is None else length
        if self.length < 1:
            raise InputError(f"length {self.length}; valid: 1 or more")
        self._counted = (0, np.zeros(len(sizes), np.int64))
        self.drawn = 0  # by this process, through all epochs
        rng = np.random.default_rng([seed, len(sizes)])
        self._offset = rng.random()
        self._keys = rng.integers(0, 2**63, (len(sizes), _ROUNDS), np.int64).astype(np.uint64)

    def __len__(self) -> int:
        return self.length

    @property
    def epoch(self) -> int:
        """Epoch of the next draw."""
        return self.drawn // self.length

    def __iter__(self) -> Iterator[tuple[int, int]]:
        """Yield the rest of the current epoch; all of it at its beginning."""
        stop = (self.epoch + 1) * self.length
        while self.drawn < stop:
            count = min(_BLOCK, stop - self.drawn)
            for pair in self.draws(self.drawn, count):
                self.drawn += 1
                yield pair

    def draws(self, first: int, count: int) -> list[tuple[int, int]]:
        """Return draws `first` … `first + count − 1` of this process; the position stays."""
        start, stop = first * self.world, (first + count) * self.world
        before = self._counts_before(start)
        chosen = self._sources(start, stop)
        items = np.empty(len(chosen), np.int64)
        for source, size in enumerate(self.sizes):
            here = np.flatnonzero(chosen == source)
            positions = before[source] + np.arange(len(here))
            items[here] = _shuffled(positions, size, self._keys[source])
        own = slice(self.rank, None, self.world)
        return list(zip(chosen[own].tolist(), items[own].tolist(), strict=True))

    def state_dict(self) -> dict[str, Any]:
        """Return the position, and what the sequence depends on."""
        return {"version": _STATE_VERSION, "drawn": self.drawn, **self._identity()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue at the position of `state`.

        Raises:
            InputError: it was taken of another mixture.
        """
        identity = {"version": _STATE_VERSION, **self._identity()}
        for key, value in identity.items():
            if state.get(key) != value:
                raise InputError(
                    f"the saved state has {key} {state.get(key)}, this mixture {value}: "
                    "it belongs to other data or another recipe"
                )
        self.drawn = int(state["drawn"])

    def _identity(self) -> dict[str, Any]:
        return {
            "seed": self.seed,
            "sizes": self.sizes,
            "shares": self.shares.round(12).tolist(),
            "length": self.length,
            "world": self.world,
            "content": self.content,
        }

    def _counts_before(self, start: int) -> NDArray[np.int64]:
        """Return each source's count in the first `start` draws; continues from the last call."""
        position, counts = self._counted if self._counted[0] <= start else (0, 0 * self._counted[1])
        for begin in range(position, start, _BLOCK * 64):
            chosen = self._sources(begin, min(start, begin + _BLOCK * 64))
            counts = counts + np.bincount(chosen, minlength=len(self.sizes))
        self._counted = (start, counts)
        return counts

    def _sources(self, start: int, stop: int) -> NDArray[np.int64]:
        turn, rank = np.divmod(np.arange(start, stop), self.world)
        points = np.modf(turn * _GOLDEN + rank / self.world + self._offset)[0]
        numbers = np.searchsorted(np.cumsum(self.shares), points, side="right")
        return np.minimum(numbers, len(self.sizes) - 1)


def _shuffled(positions: NDArray[np.int64], size: int, key: NDArray[np.uint64]) -> NDArray:
    """Return the item at each position of an endless sequence of shuffles of `size` items.

    A Feistel network permutes the smallest even power of two that holds them; results beyond
    `size` are permuted again until they lie below it (cycle walking: Black and Rogaway, 2002).
    """
    half = np.uint64(max((max(size - 1, 1).bit_length() + 1) // 2, 1))
    low = (np.uint64(1) << half) - np.uint64(1)
    passes = (positions // size).astype(np.uint64)
    values = (positions % size).astype(np.uint64)
    left = np.ones(len(values), bool)
    while left.any():
        value, turn = values[left], passes[left]
        a, b = value >> half, value & low
        for number in range(_ROUNDS):
            a, b = b, a ^ (_mix(b ^ (turn << np.uint64(32)), key[number]) & low)
        values[left] = (a << half) | b
        left[left] = values[left] >= size
    return values.astype(np.int64)


def _mix(value: NDArray[np.uint64], key: np.uint64) -> NDArray[np.uint64]:
    """Return a hash of 64 bits (the finalizer of splitmix64: Steele, Lea and Flood, 2014)."""
    with np.errstate(over="ignore"):
        value = value + key
        value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return value ^ (value >> np.uint64(31))
