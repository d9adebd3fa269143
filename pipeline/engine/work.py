"""Work items: what is to be done, under which key, and with which outputs."""

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ...formats.process.source import source_digest


@dataclass(frozen=True)
class ItemResult:
    """The outcome that a job returns.

    Attributes:
        facts: JSON values for later stages and the report.
        failed: the item is done, but its outcome is bad (a fall, …).
    """

    facts: dict[str, Any] = field(default_factory=dict)
    failed: bool = False


class Job(Protocol):
    """The work of one item: a picklable, frozen dataclass of a module in `pipeline.stages`.

    A job that needs a library only for some inputs has a property `unused_libraries` for the
    others, so that installing one (most come with an extra) repeats no work that had no use of it.
    """

    def run(self) -> ItemResult:
        """Do the work, in a worker process; write each output atomically."""
        ...


@dataclass(frozen=True)
class WorkItem:
    """One unit of work.

    Attributes:
        name: unique within its stage.
        key: digest of configuration, inputs and code; an item done with the same key is not done
            again.
        outputs: files or folders that the job writes, each atomically.
        inputs: what decides the result, by what it is called; to explain why a key changed.
    """

    name: str
    key: str
    outputs: tuple[Path, ...]
    job: Job
    inputs: Mapping[str, Any] = field(default_factory=dict)


def work_item(
    stage: str, name: str, job: Job, outputs: tuple[Path, ...], *inputs: Any, **named: Any
) -> WorkItem:
    """Return an item whose key covers its stage, `inputs`, and the code that the job imports.

    Args:
        name: unique within the stage.
        job: what to do. Its module imports all that the work needs and nothing else, so that an
            edit elsewhere does not repeat the work.
        outputs: what the job writes.
        inputs: everything else that decides the result: configuration, keys of the items that
            the job reads, digests of the user's files. Not the job's paths, which may move.
        named: more inputs, whose names `--explain` prints; for values that do not show what
            they are.
    """
    code = source_digest(type(job).__module__, unused=unused_libraries(job))
    called = {f"{type(value).__name__} {k}": value for k, value in enumerate(inputs, start=1)}
    key = digest(stage, *inputs, *sorted(named.items()), code)
    return WorkItem(name, key, outputs, job, {**called, **named})


def unused_libraries(job: Job) -> frozenset[str]:
    """Return the distributions that a job's modules import, but that it does not use."""
    return getattr(job, "unused_libraries", frozenset())


def digest(*parts: Any) -> str:
    """Return the SHA-256 hex of nested dataclasses, mappings, sequences, paths and JSON values."""
    text = json.dumps([_plain(p) for p in parts], sort_keys=True, allow_nan=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return {"__type__": type(value).__qualname__, **fields}
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    return value
