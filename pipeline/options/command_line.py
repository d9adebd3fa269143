"""The command line that options came from, and the mistakes in one."""

import math
import shlex
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, field, fields, make_dataclass
from inspect import get_annotations
from itertools import pairwise
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin

from ...formats.core.checkout import program
from ...formats.core.errors import InputError, brief, check_name, did_you_mean

# A command that runs an item again has options of its own for these.
LEFT_OUT = {
    "only", "explain", "retry_quarantined", "wait", "json", "max_failed",
    "workers", "executor", "ray_address", "slurm", "dry_run",
}  # fmt: skip
# Every command has the options of its parser for shell completion.
COMPLETION = "--tyro-"
HELP = {"-h", "--help"}
ABSENT = "\0"  # what no word of a command line is


def command_line(options: Any) -> str:
    """Return a shell command with the same effect as `options`, from any folder.

    Args:
        options: An instance of a class of `pipeline.options` whose command has its name in lower
            case letters.
    """
    words = [program(), type(options).__name__.lower()]
    for entry in fields(options):
        value = getattr(options, entry.name)
        default = None if entry.default is MISSING else entry.default
        if entry.name in LEFT_OUT or value is None or value == default:
            continue
        if "Positional" in str(entry.type):
            words.append(str(value))
        elif value is True or value is False:
            words.append(f"--{'' if value else 'no-'}{entry.name.replace('_', '-')}")
        elif isinstance(value, tuple | list):
            words += [_option(entry), *map(str, value)]
        else:
            words += [_option(entry), str(value)]
    return f"cd {shlex.quote(str(Path.cwd()))} && {shlex.join(words)}"


def parsed(command: str, words: Sequence[str], record: type) -> Any:
    """Return the options that a command's words set, as an instance of `record`; exit after help.

    Tyro answers what is missing with many lines, so required options have a stand-in here.
    """
    check_options(command, words, record)
    given = {word.split("=")[0].replace("_", "-") for word in words}
    help_requested = bool(HELP & given)  # then tyro exits, and says what is required
    if not help_requested:
        _check_values(command, words, record)
    import tyro  # late, because the list of commands needs none of it

    needed = [entry for entry in fields(record) if entry.default is MISSING]
    stand_ins = {f.name: tyro.MISSING if _option(f) in given else _stand_in(f.type) for f in needed}
    options, strays = tyro.cli(
        _with_help(record) if help_requested else record,
        prog=f"vlnpe {command}",
        args=words,
        config=(tyro.conf.OmitArgPrefixes,),
        return_unknown_args=True,
        **({} if help_requested else {"default": record(**stand_ins)}),
    )
    if strays:
        raise unknown_word(command, strays[0], option_names(record))
    missing = [
        option or entry.name.upper()
        for entry, option in zip(needed, map(_option, needed), strict=True)
        if (option and option not in given) or str(getattr(options, entry.name)) == ABSENT
    ]
    if missing:
        what = f"{' and '.join(missing)} {'are' if len(missing) > 1 else 'is'} missing"
        raise InputError(f"{command}: {what}; see {program()} {command} --help")
    return options


def _with_help(record: type) -> type:
    """Return a dataclass whose help has a class's own options before those of its bases.

    Tyro lists options of bases first, keeps the line breaks of docstrings that are indented, and
    writes `{None}|PATH (default: None)` where the text says what happens without the option.
    """
    import tyro
    from docstring_parser import parse_from_object

    by_name = {entry.name: entry for entry in fields(record)}
    texts: dict[str, str] = {}
    for base in reversed(record.__mro__[:-1]):
        for text in parse_from_object(base).params:
            texts[text.arg_name] = " ".join((text.description or "").split())
    order = [name for base in record.__mro__ for name in get_annotations(base) if name in by_name]
    parts = []
    for entry in (by_name[name] for name in dict.fromkeys(order)):
        shown: dict[str, Any] = {"help": texts.get(entry.name)}
        if entry.default is None:
            shown["help_behavior_hint"] = ""
            given = get_args(entry.type)
            given = get_args(given[0]) if get_origin(entry.type) is Annotated else given
            (kind,) = (kind for kind in given if kind is not NoneType)
            names = ",".join(get_args(kind))  # of a Literal
            shown["metavar"] = f"{{{names}}}" if names else kind.__name__.upper()
        described = Annotated[entry.type, tyro.conf.arg(**shown)]
        parts.append((entry.name, described, field(default=entry.default)))
    return make_dataclass(
        record.__name__, parts, namespace={"__doc__": record.__doc__}, kw_only=True
    )


def _option(entry: Field[Any]) -> str:
    """Return how a field is written as an option; empty for a positional argument."""
    option = f"--{entry.name.rstrip('_').replace('_', '-')}"  # `import_` is the option --import
    return "" if "Positional" in str(entry.type) else option


def _stand_in(kind: Any) -> Any:
    """Return a value of a type of required options, one that no user gives where it can be told."""
    kind = get_args(kind)[0] if get_origin(kind) is Annotated else kind
    if get_origin(kind) is Literal:
        return get_args(kind)[0]
    return () if get_origin(kind) is tuple else kind(ABSENT)


def option_names(record: type) -> set[str]:
    """Return how the options of a class of `pipeline.options` are written: `--out`, `--no-json`."""
    named = [entry for entry in fields(record) if "Positional" not in str(entry.type)]
    words = {entry.name.rstrip("_") for entry in named} | {
        f"no_{f.name}" for f in named if "bool" in str(f.type)
    }
    return {f"--{word.replace('_', '-')}" for word in words | {"help"}}


def check_options(command: str, words: Sequence[str], record: type) -> None:
    """Raise InputError for the first of a command's words that is an option unknown to `record`."""
    valid = option_names(record)
    for word in (word.split("=")[0] for word in words if word.startswith("--")):
        if word.replace("_", "-") not in valid and not word.startswith(COMPLETION):
            raise unknown_word(command, word, valid)


def _check_values(command: str, words: Sequence[str], record: type) -> None:
    """Raise InputError for an option without its value, or with one that is not of its kind.

    Tyro answers these with a box of many lines. What is not checked here is left to it.
    """
    kinds = {_option(f): (f.type, *get_args(f.type)) for f in fields(record) if _option(f)}
    numbers = [f.name for f in fields(record) if not _option(f) and int in get_args(f.type)]
    for name, value in zip(numbers, _positional(words, kinds), strict=False):
        if not _is(int, value):
            raise InputError(f"{name.upper()} {brief(value)}: not a whole number")
    for word, following in pairwise([*words, ABSENT]):
        option, separator, value = word.partition("=")
        option, value = option.replace("_", "-"), value if separator else following
        of = kinds.get(option, ())
        if not of or bool in of or (NoneType in of and value == "None"):
            continue
        if value == ABSENT or (value.startswith("--") and not separator):
            raise InputError(f"{option}: no value follows; see {program()} {command} --help")
        for kind in of:
            if get_origin(kind) is Literal:
                check_name(option, value, get_args(kind))
        if int in of and not _is(int, value):
            raise InputError(f"{option} {brief(value)}: not a whole number")
        if float in of and not _is(float, value):
            raise InputError(f"{option} {brief(value)}: not a number")


def _positional(words: Sequence[str], kinds: Mapping[str, tuple[Any, ...]]) -> Iterator[str]:
    """Yield the words that are neither an option nor the value of one."""
    is_value = False
    for word in words:
        if word.startswith("-"):
            of = kinds.get(word.replace("_", "-"), ())  # none, if its value follows a `=`
            is_value = bool(of) and bool not in of
        elif not is_value:
            yield word
        else:
            is_value = False


def _is(kind: type[int] | type[float], text: str) -> bool:
    """Return whether a text is a finite number of this kind."""
    try:
        return math.isfinite(kind(text))
    except (OverflowError, ValueError):
        return False


def unknown_word(command: str, word: str, valid: Collection[str] = ()) -> InputError:
    """Return the error for a word that means nothing to a command ("" for `vlnpe` itself).

    For an option it names the closest of the `valid` ones: the one spelt alike, or those that it is
    a part of, as `--radius` is of `--robot-radius-m`.
    """
    kind, hint = "argument", ""
    if word.startswith("-"):
        bare = word.strip("-_").replace("_", "-")
        within = sorted(entry for entry in valid if f"-{bare}-" in f"{entry}-")[:3]
        kind, hint = "option", did_you_mean(f"--{bare}", valid)
        hint = hint or (f" (did you mean {' or '.join(within)}?)" if within else "")
    listed = " ".join([program(), *filter(None, [command]), "--help"])
    return InputError(f"unknown {kind} {brief(word)}{hint}; {listed} lists the valid ones")
