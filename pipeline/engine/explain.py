"""Say why an item runs or is reused: which part of what it is made of has changed."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from typing import Any

import numpy as np

from ...formats.process.source import NAME, imported_modules, libraries, module_digest
from .work import Job, digest, unused_libraries

CODE = "code"
SHORT = 16  # characters kept of a digest
PLAIN = 60  # characters of a value that is shown as it is


@dataclass(frozen=True)
class Part:
    """One thing that an item is made of.

    Attributes:
        digest: Of all of it.
        values: Its values by name, of long ones a digest; they are shared by the items that are
            made of the same thing.
    """

    digest: str
    values: dict[str, str]


def parts_of(inputs: Mapping[str, Any], job: Job) -> dict[str, Part]:
    """Return what an item is made of, by name."""
    parts = {
        name: Part(value[:SHORT] if _is_digest(value) else digest(value)[:SHORT], _values(value))
        for name, value in inputs.items()
    }
    return {**parts, CODE: _code(type(job).__module__, unused_libraries(job))}


def changes(
    before: Mapping[str, str],
    values: Mapping[str, Mapping[str, str]],
    now: Mapping[str, Part],
    items: Mapping[str, str],
) -> list[str]:
    """Return what differs between an item's parts then and now, one line each.

    Args:
        before: Digests of the parts when the item was done, by name.
        values: Values of parts by digest, as far as they are known.
        items: Names of items by the beginnings of their keys: an item that reads others has
            their keys among its parts.
    """
    lines = []
    for name in sorted({*before, *now}):
        old, new = before.get(name), now.get(name)
        if new is None or old is None:
            lines.append(
                f"{_part_label(name)} is {'new' if old is None else 'no longer part of it'}"
            )
        elif old != new.digest and new.digest in items:
            lines.append(f"{items[new.digest]} was made again")
        elif old != new.digest:
            lines += _differences(_part_label(name), values.get(old, {}), new.values)
    return lines


def _differences(name: str, old: Mapping[str, str], new: Mapping[str, str]) -> list[str]:
    lines = []
    for key in sorted({*old, *new}):
        if old.get(key) != new.get(key):
            where = f"{name}.{key}" if key else name
            then, now = old.get(key, "nothing"), new.get(key, "nothing")
            # Digests mean nothing to a reader.
            plain = ":" in key if name == CODE else "…" not in (then[:1], now[:1])
            lines.append(f"{where}: {then} → {now}" if plain else f"{where} changed")
    return lines or [f"{name} changed"]


def _part_label(name: str) -> str:
    """Return how a part is called; inputs without a name are called by type and place."""
    kind, _, place = name.rpartition(" ")
    if not kind:
        return name
    return f"input {place}, the key of what it is made from," if kind == "str" else kind


def _is_digest(value: Any) -> bool:
    return isinstance(value, str) and len(value) == 64 and value.isalnum()


def _values(value: Any) -> dict[str, str]:
    """Return the values of a configuration, or a short value under an empty name."""
    if is_dataclass(value) and not isinstance(value, type):
        values: dict[str, str] = {}
        for entry in fields(value):
            inner = getattr(value, entry.name)
            if is_dataclass(inner):
                values |= {f"{entry.name}.{k}" if k else entry.name: v
                          for k, v in _values(inner).items()}  # fmt: skip
            elif isinstance(inner, dict):
                values |= {f"{entry.name}.{k}": _short(v) for k, v in inner.items()}
            else:
                values |= {entry.name: _short(inner)}
        return values
    return {} if _is_digest(value) or len(_short(value)) == SHORT + 1 else {"": _short(value)}


def _short(value: Any) -> str:
    plain = value.tolist() if isinstance(value, np.ndarray) else value
    text = json.dumps(plain, default=str, sort_keys=True)
    return text if len(text) <= PLAIN else f"…{digest(text)[:SHORT]}"


@cache
def _code(module: str, unused: frozenset[str]) -> Part:
    modules = imported_modules(module.removeprefix(f"{NAME}."))
    digests = {name: module_digest(name)[:8] for name in modules}
    digests |= {f"library:{name}": v for name, v in libraries(module).items() if name not in unused}
    return Part(digest(digests)[:SHORT], digests)
