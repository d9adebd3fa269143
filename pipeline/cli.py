"""The `vlnpe` command."""

import argparse
import ast
import logging
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Union

from ..formats.core.errors import InputError, UnknownNameError, VlnpeError
from ..formats.process.memory import collect_cycles_less_often
from ..formats.untrusted.files import is_text
from .engine.signals import (
    PIPE_CLOSED,
    DryRun,
    Interrupted,
    OnlyDone,
    closed_streams,
    interruptible,
    without_interrupts,
)
from .extras import check_extras
from .options.command_line import COMPLETION, parsed, unknown_word
from .store.address import store_url, without_password


@dataclass(frozen=True)
class Verb:
    """One command, named without importing it: its module may need seconds for its libraries.

    Attributes:
        name: What the user types.
        record: Options class, as `module.Class` of `pipeline.options`.
        function: What takes the options and returns the exit code, as `module.function` of
            `pipeline`.
    """

    name: str
    record: str
    function: str

    def options(self) -> type:
        """Return the options class; its module imports no numerical library."""
        return _imported(f"options.{self.record}")

    def run(self) -> Callable[[Any], int]:
        """Import the command and return the function that runs it."""
        return _imported(self.function)

    def summary(self) -> str:
        """Return the first paragraph of the options class's docstring, read from the source."""
        module, record = self.record.split(".")
        path = Path(__file__).parent / "options" / f"{module}.py"
        classes = [n for n in ast.parse(path.read_bytes()).body if isinstance(n, ast.ClassDef)]
        docstring = next(ast.get_docstring(n) for n in classes if n.name == record)
        return " ".join((docstring or "").split("\n\n")[0].split())


def _imported(path: str) -> Any:
    module, _, name = path.rpartition(".")
    return getattr(import_module(f".{module}", __package__), name)


# In the chain's order.
_TABLE = (
    Verb("collect", "collect.Collect", "collect.command.run"),
    Verb("scan", "scenes.Scan", "commands.scenes.run_scan"),
    Verb("repair", "scenes.Repair", "commands.scenes.run_repair"),
    Verb("align", "episodes.Align", "commands.episodes.run_align"),
    Verb("filter", "episodes.Filter", "commands.episodes.run_filter"),
    Verb("sample", "episodes.Sample", "commands.episodes.run_sample"),
    Verb("instruct", "instructions.Instruct", "commands.instruct.run"),
    Verb("check-text", "instructions.CheckText", "commands.check_text.run"),
    Verb("review", "instructions.Review", "commands.review.run"),
    Verb("replay", "rollouts.Replay", "commands.rollouts.run_replay"),
    Verb("render", "rollouts.Render", "commands.rollouts.run_render"),
    Verb("export", "rollouts.Export", "commands.rollouts.run_export"),
    Verb("convert", "convert.Convert", "commands.convert.run_convert"),
    Verb("restore", "convert.Restore", "commands.convert.run_restore"),
    Verb("robots", "robots.Robots", "commands.robots.run_robots"),
    Verb("mix", "training.Mix", "commands.training.mix.run"),
    Verb("train", "training.Train", "commands.training.train.run"),
    Verb("ablate", "training.Ablate", "commands.training.ablate.run"),
    Verb("adapt", "training.Adapt", "commands.training.adapt.run"),
    Verb("view", "viewer.View", "commands.view.run"),
    Verb("evaluate", "evaluate.Evaluate", "commands.policies.evaluate.run_evaluate"),
    Verb("dagger", "evaluate.Dagger", "commands.policies.dagger.run"),
    Verb("drive", "viewer.Drive", "commands.drive.run"),
    Verb("serve", "evaluate.Serve", "commands.policies.serve.run"),
    Verb("benchmark", "evaluate.Benchmark", "commands.policies.benchmark.run"),
    Verb("compare", "evaluate.Compare", "commands.policies.evaluate.run_compare"),
    Verb("push", "results.Push", "commands.push.run_push"),
    Verb("verify", "results.Verify", "commands.look.run_verify"),
    Verb("report", "results.Report", "commands.look.run_report"),
    Verb("doctor", "results.Doctor", "commands.look.run_doctor"),
)
VERBS = {verb.name: verb for verb in _TABLE}

DESCRIPTION = """Turn scanned buildings into cross-embodiment VLN datasets with simulated robots.

`vlnpe collect` runs the whole pipeline; every stage can also be run on its own. Exit codes:
0 success, 1 more items quarantined than --max-failed allows or a scene that is not sound, 2 invalid
input, 3 (verify) sound but not finished, 128 + N ended by signal N (130 Ctrl-C, 143 SIGTERM)."""


# Next to the bytecode of Python and numba; matplotlib's default is the user's home directory.
FONT_LIST_FOLDER = Path(__file__).parent / "__pycache__" / "matplotlib"


def parse(arguments: Sequence[str]) -> tuple[Verb, Any]:
    """Return the command and its options; exit with code 2 on a bad option, with 0 after help.

    Only the command that is named gets imported, and none for the list of commands.
    """
    if arguments and arguments[0] in ("-h", "--help"):
        _overview().print_help()
        sys.exit(0)
    if arguments and arguments[0] == "--version":
        sys.stdout.write(f"vlnpe {version('vlnpe')}\n")
        sys.exit(0)
    if arguments and (verb := VERBS.get(arguments[0])):
        return verb, parsed(verb.name, arguments[1:], verb.options())
    if arguments and not arguments[0].startswith("-"):
        raise UnknownNameError("command", arguments[0], VERBS)
    if arguments and not arguments[0].startswith(COMPLETION):
        raise unknown_word("", arguments[0])
    import tyro

    # A call without a command and shell completion need the options of all.
    records = {verb.options(): verb for verb in VERBS.values()}
    verbs = [
        Annotated[record, tyro.conf.subcommand(name=verb.name, prefix_name=False)]
        for record, verb in records.items()
    ]
    options = tyro.cli(
        Union[tuple(verbs)],  # type: ignore[arg-type]  # noqa: UP007 - built at run time
        prog="vlnpe",
        description=DESCRIPTION,
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes,),
    )
    return records[type(options)], options


def _overview() -> argparse.ArgumentParser:
    """Return a parser whose help lists the commands."""
    parser = argparse.ArgumentParser(
        "vlnpe",
        usage="vlnpe [-h] [--version] COMMAND …",
        description=DESCRIPTION,
        epilog="`vlnpe COMMAND --help` lists a command's options.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")
    for verb in VERBS.values():
        commands.add_parser(verb.name, help=verb.summary(), add_help=False)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand and return the exit code."""
    try:
        with interruptible():
            try:
                return _run(sys.argv[1:] if arguments is None else arguments)
            finally:
                sys.stdout.flush()  # a closed pipe must show here, not when Python ends
    except Interrupted as stop:
        return stop.exit_code
    except BrokenPipeError:
        if not (closed := closed_streams()):
            raise
        for stream in closed:  # Python flushes them once more
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        return PIPE_CLOSED


def _run(arguments: Sequence[str]) -> int:
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    os.environ.setdefault("MPLCONFIGDIR", str(FONT_LIST_FOLDER))
    # GLFW's import starts a process in every worker; the renderer `gl` opens EGL itself.
    os.environ.setdefault("MUJOCO_GL", "disable")
    collect_cycles_less_often()
    for argument in arguments:
        if not is_text(Path(argument)):
            _complain(f"{argument!a} is not UTF-8; rename the file or folder")
            return 2
        if argument != (masked := without_password(argument)):
            _complain(f"{masked}: a run records its command; valid: passwords in the environment")
            return 2
    try:
        with without_interrupts():  # its imports would swallow one that comes in a callback
            verb, options = parse(arguments)
            check_extras(verb.name, options)
        if verb.name != "verify":  # which must read what the store holds now
            options = _with_local_inputs(options)
        if (seed := getattr(options, "seed", None)) is not None and seed < 0:
            raise InputError(f"seed {seed}: valid: 0 and above")
        if check := getattr(options, "check", None):
            check()  # before seconds of imports
        with without_interrupts():
            run = verb.run()
        return run(options)
    except OnlyDone as only:
        return int(not only.good)
    except DryRun as written:
        sys.stdout.write(f"{written}\n")
        return 0
    except InputError as error:
        _complain(error)
        return 2
    except OSError as error:
        if isinstance(error, BrokenPipeError) and closed_streams():
            raise
        _complain(f"cannot use {error.filename or 'a file'}: {error.strerror or error}")
        return 2
    except VlnpeError as error:
        _complain(error)
        return 1


def _with_local_inputs(options: Any) -> Any:
    """Return the options with local copies in the place of runs in an object store."""
    paths = {f.name: getattr(options, f.name) for f in fields(options) if f.name != "out"}
    urls = {n: store_url(path) for n, path in paths.items() if isinstance(path, Path)}
    if not any(urls.values()):
        return options
    from .store.mirror import fetched

    return replace(options, **{name: fetched(url) for name, url in urls.items() if url})


def _complain(message: object) -> None:
    line = " ".join(str(message).split())
    sys.stderr.write(f"vlnpe: error: {line}\n")
    sys.stderr.writelines(f"  {hint}\n" for hint in getattr(message, "hints", ()))


if __name__ == "__main__":
    sys.exit(main())
