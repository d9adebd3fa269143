"""Parse YAML from untrusted sources, within limits of size, nesting and expanded aliases."""

from pathlib import Path
from typing import Any

import yaml

from ..core.errors import FileFormatError
from .files import read_input
from .limits import limits

# Longer plain scalars are not numbers or dates, and turning them into some takes quadratic time.
MAX_PLAIN_SCALAR = 1000


def read_yaml(path: Path) -> Any:
    """Return the value of a YAML file of plain mappings, lists and scalars.

    Anchors and aliases may be used as long as the document stays small with all of them written
    out.

    Raises:
        FileFormatError: missing, not a regular file, not YAML, or beyond a limit.
    """
    try:
        text = read_input(path, max_bytes=limits().text_bytes).decode()
        _check_events(path, text)
        return yaml.safe_load(text)
    except yaml.MarkedYAMLError as error:
        line = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        raise FileFormatError(path, f"not YAML: {line}{error.problem}") from error
    except yaml.YAMLError as error:
        raise FileFormatError(path, f"not YAML: {_brief(error)}") from error
    except (ValueError, RecursionError) as error:  # dates that do not exist, bad UTF-8
        raise FileFormatError(path, f"not YAML: {_brief(error)}") from error


def _check_events(path: Path, text: str) -> None:
    """Count what the document becomes when every alias is written out."""
    caps = limits()
    sizes: dict[str, int] = {}
    # Of each open list or mapping: its anchor, and the nodes in it so far.
    stack: list[tuple[str | None, int]] = [(None, 0)]

    def close(anchor: str | None, size: int) -> None:
        if anchor is not None:
            sizes[anchor] = size
        above, total = stack.pop()
        if total + size > caps.yaml_nodes:
            raise FileFormatError(
                path,
                f"has more than {caps.yaml_nodes:,} values with its aliases written out, "
                "which is the limit",
            )
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
                raise FileFormatError(
                    path,
                    f"line {event.start_mark.line + 1}: {len(event.value):,} characters without "
                    f"quotes; valid: up to {MAX_PLAIN_SCALAR:,}",
                )
            close(event.anchor, 1)
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise FileFormatError(
                    path,
                    f"line {event.start_mark.line + 1}: alias *{event.anchor} refers to itself or "
                    "to nothing above it",
                )
            close(None, sizes[event.anchor])


def _brief(error: Exception) -> str:
    return " ".join(str(error).split())[:300]
