"""Put a record's values back into the JSON it was read from, without losing anything else."""

from collections.abc import Collection
from typing import Any


def overlay(source: Any, values: Any, removed: Collection[str] = ()) -> Any:
    """Return `source` (None if there is none) with `values` in it, and without keys in `removed`.

    Order, unknown keys and spelling of equal values stay. Objects are merged key by key; keys that
    `source` lacks follow at the end. Lists of equal length are merged item by item, others are
    replaced. Equal numbers keep their spelling (1, not 1.0).
    """
    if isinstance(source, dict) and isinstance(values, dict):
        merged = {
            key: overlay(value, values[key]) if key in values else value
            for key, value in source.items()
            if key not in removed
        }
        return merged | {key: value for key, value in values.items() if key not in source}
    if isinstance(source, list) and isinstance(values, list) and len(source) == len(values):
        if source == values:
            return source
        return [overlay(a, b) for a, b in zip(source, values, strict=True)]
    return source if source == values else values
