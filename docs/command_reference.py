"""The options of every command as Markdown, from the dataclasses that the command line parses."""

import re
from dataclasses import MISSING, Field, fields
from inspect import cleandoc, get_annotations
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin

from docstring_parser import parse_from_object

from vlnpe.pipeline.cli import VERBS

PAGE = re.compile(r"docs/([\w/]+)\.md")


def command_reference() -> str:
    """Return one section per command, then one per group of options that several commands share."""
    records = {name: verb.options() for name, verb in VERBS.items()}
    shared: dict[type, None] = {}
    parts = []
    for name, record in records.items():
        bases = [base for base in record.__mro__[1:-1] if get_annotations(base)]
        shared |= dict.fromkeys(bases)
        also = ", ".join(f"[{_title(base)}](#{_anchor(base)})" for base in bases)
        parts += [f"## vlnpe {name}", _prose(record), _table(record)]
        parts += [f"Shared options: {also}." if also else ""]
    parts.append("## Shared options")
    for base in shared:
        users = ", ".join(f"`{name}`" for name, record in records.items() if base in record.__mro__)
        parts += [f"({_anchor(base)})=\n### {_title(base)}", f"For {users}.", _table(base)]
    return "\n\n".join(filter(None, parts))


def _prose(record: type) -> str:
    """Return a class's docstring, its indented example as a block of code."""
    text = _linked(re.sub(r"<(?=\w)", r"\\<", cleandoc(record.__doc__ or "")))
    return re.sub(r"\n((?:  .*(?:\n|$))+)", r"\n\n```sh\n\1\n```\n", text)


def _title(base: type) -> str:
    return (base.__doc__ or base.__name__).split("\n")[0].rstrip(".")


def _anchor(base: type) -> str:
    return f"options-{base.__name__.lower()}"


def _table(record: type) -> str:
    """Return the options that a class itself defines, positional arguments first."""
    own = get_annotations(record)
    texts = {text.arg_name: text.description for text in parse_from_object(record).params}
    listed = sorted((one for one in fields(record) if one.name in own), key=_is_option)
    rows = [
        f"| {_name(one)} | {_default(one)} | {_cell(texts.get(one.name) or _help(one))} |"
        for one in listed
    ]
    return (
        "\n".join(["| option | default | meaning |", "| --- | --- | --- |", *rows]) if rows else ""
    )


def _help(one: Field[Any]) -> str:
    """Return the text that `tyro.conf.arg` gives an option without a docstring."""
    return next(text for note in get_args(one.type) if (text := getattr(note, "help", None)))


def _is_option(one: Field[Any]) -> bool:
    return "Positional" not in str(one.type)


def _name(one: Field[Any]) -> str:
    option = f"--{one.name.rstrip('_').replace('_', '-')}"
    kind = get_args(one.type)[0] if get_origin(one.type) is Annotated else one.type
    if not _is_option(one):
        return f"`{one.name.upper()}`"
    if kind is bool or set(get_args(kind)) == {bool, NoneType}:
        return f"`{option if one.default is False else option.replace('--', '--no-', 1)}`"
    kinds = [part for part in get_args(kind) or (kind,) if part is not NoneType]
    if get_origin(kind) is Literal:
        return f"`{option} {{{','.join(map(str, kinds))}}}`"
    if get_origin(kinds[0]) is Literal:
        return f"`{option} {{{','.join(map(str, get_args(kinds[0])))}}}`"
    name = getattr(kinds[0], "__name__", str(kinds[0])).upper()
    return f"`{option} {name}{' …' if get_origin(kind) is tuple else ''}`"


def _default(one: Field[Any]) -> str:
    if one.default is MISSING:
        return "required"
    if one.default in (None, "", ()) or one.type is bool:
        return ""
    values = one.default if isinstance(one.default, tuple) else (one.default,)
    return f"`{' '.join(map(str, values))}`"


def _cell(text: str) -> str:
    """Return a text for a table; outside of code, what Markdown would read is escaped."""
    parts = " ".join(text.split()).replace("|", "\\|").split("`")
    parts[::2] = [re.sub(r"([<*])", r"\\\1", part) for part in parts[::2]]
    return _linked("`".join(parts))


def _linked(text: str) -> str:
    return PAGE.sub(r"[\1](../\1.md)", text)
