"""Parse YAML from untrusted sources, within limits of size, nesting and expanded aliases."""

from pathlib import Path
from typing import Any

import yaml

from ..core.errors import FileFormatError, one_line
from .files import read_input
from .limits import limits

# Longer plain scalars are not numbers or dates, and turning them into some takes quadratic time.
MAX_PLAIN_SCALAR = 1000


def read_yaml(path: Path) -> Any:
    """Return the value of a YAML file of plain mappings, lists and scalars.

    Anchors and aliases may be used as long as the document stays small with all of them written
    out.
    """
    try:
        text = read_input(path, max_bytes=limits().text_bytes).decode()
        _check_events(path, text)
        return yaml.safe_load(text)
    except yaml.MarkedYAMLError as error:
        line = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        raise FileFormatError(path, f"not YAML: {line}{error.problem}") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # also dates that do not exist
        raise FileFormatError(path, f"not YAML: {one_line(error)}") from error


def _check_events(path: Path, text: str) -> None:
    """Count what the document becomes when every alias is written out."""
    caps = limits()
    sizes: dict[str, int] = {}
    # The anchor of each open list or mapping, and the nodes in it so far.
    stack: list[tuple[str | None, int]] = [(None, 0)]

    def refuse(event: yaml.Event, reason: str) -> FileFormatError:
        return FileFormatError(path, f"line {event.start_mark.line + 1}: {reason}")

    def close(anchor: str | None, size: int) -> None:
        if anchor is not None:
            sizes[anchor] = size
        above, total = stack.pop()
        if total + size > caps.yaml_nodes:
            most = f"{caps.yaml_nodes:,} values with its aliases written out"
            raise FileFormatError(path, f"has more than {most}, which is the limit")
        stack.append((above, total + size))

    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        if isinstance(event, yaml.CollectionStartEvent):
            stack.append((event.anchor, 1))
            # An alias inside its own anchor has no size yet.
            sizes.pop(event.anchor or "", None)
            if len(stack) > caps.depth + 1:
                raise FileFormatError(path, f"nested too deeply; valid: up to {caps.depth} levels")
        elif isinstance(event, yaml.CollectionEndEvent):
            close(*stack.pop())
        elif isinstance(event, yaml.ScalarEvent):
            if event.style is None and len(event.value) > MAX_PLAIN_SCALAR:
                size = f"{len(event.value):,} characters without quotes"
                raise refuse(event, f"{size}; valid: up to {MAX_PLAIN_SCALAR:,}")
            close(event.anchor, 1)
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                alias = f"alias *{event.anchor}"
                raise refuse(event, f"{alias} refers to itself or to nothing above it")
            close(None, sizes[event.anchor])
