"""Damage every file of a run, a byte each."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np


@contextmanager
def flipped(
    root: Path, rng: np.random.Generator, spare: tuple[str, ...] = ()
) -> Iterator[list[Path]]:
    """Flip bits of one byte in every file of a run, and restore them after the block.

    Args:
        root: The run.
        rng: Chooses the places and the bits.
        spare: Files that stay sound, by their path in the run.

    Yields:
        The damaged files.
    """
    paths = sorted(p for p in root.rglob("*") if p.is_file() and p.stat().st_size)
    saved = {p: p.read_bytes() for p in paths if p.relative_to(root).as_posix() not in spare}
    try:
        for path, content in saved.items():
            damaged = bytearray(content)
            damaged[int(rng.integers(len(content)))] ^= int(rng.integers(1, 256))
            path.unlink()  # hard links of it stay sound
            path.write_bytes(damaged)
        yield list(saved)
    finally:
        for path, content in saved.items():
            path.write_bytes(content)
