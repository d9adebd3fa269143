"""Usage of a language model, counted over all processes that share a cache folder."""

import contextlib
import fcntl
import json
import threading
from collections.abc import Iterator
from dataclasses import asdict, astuple, dataclass
from operator import add
from pathlib import Path
from typing import IO

from ...formats.core.errors import VlnpeError
from .settings import LlmSettings


class BudgetError(VlnpeError):
    """The limit of tokens or cost is reached."""


@dataclass(frozen=True)
class Usage:
    """Tokens and cost of one or many requests."""

    requests: int = 0
    tokens_in: int = 0
    tokens_out: int = 0
    cost: float = 0.0

    def __add__(self, other: "Usage") -> "Usage":
        return Usage(*map(add, astuple(self), astuple(other)))


class Budget:
    """Counts usage in a file and refuses to begin what exceeds the limits."""

    def __init__(self, path: Path, settings: LlmSettings):
        """Count in `path`, which need not exist."""
        self._path, self._settings = path, settings
        self._lock = threading.Lock()
        path.parent.mkdir(parents=True, exist_ok=True)

    def check(self) -> None:
        """Raise BudgetError when a limit is reached."""
        used, limit = self.used(), self._settings
        tokens = used.tokens_in + used.tokens_out
        if limit.max_tokens and tokens >= limit.max_tokens:
            raise BudgetError(f"--max-tokens {limit.max_tokens} is reached ({tokens} used)")
        if limit.max_cost and used.cost >= limit.max_cost:
            raise BudgetError(f"--max-cost {limit.max_cost:g} is reached ({used.cost:.4f} spent)")

    def used(self) -> Usage:
        """Return everything used so far."""
        with self._open() as stream:
            return _read(stream)

    def add(self, usage: Usage) -> None:
        """Count one request."""
        with self._open() as stream:
            total = _read(stream) + usage
            stream.seek(0)
            stream.truncate()
            stream.write(json.dumps(asdict(total)))

    @contextlib.contextmanager
    def _open(self) -> Iterator[IO[str]]:
        with self._lock, self._path.open("a+") as stream:
            fcntl.flock(stream, fcntl.LOCK_EX)
            stream.seek(0)
            yield stream
            stream.flush()


def _read(stream: IO[str]) -> Usage:
    text = stream.read()
    try:
        return Usage(**json.loads(text)) if text else Usage()
    except (ValueError, TypeError):  # killed while it was written
        return Usage()
