"""The `vlnpe` command."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, Union

import tyro

from ..formats.core.errors import InputError, VlnpeError
from .commands import ablate, chain, collect, convert, look, mix, push, restore, robots, rollouts

# Subcommand → (options, function that runs it), in pipeline order.
VERBS: dict[str, tuple[type, Callable[[Any], int]]] = {
    "collect": (collect.Collect, collect.run),
    "scan": (chain.Scan, chain.run_scan),
    "repair": (chain.Repair, chain.run_repair),
    "align": (chain.Align, chain.run_align),
    "filter": (chain.Filter, chain.run_filter),
    "sample": (chain.Sample, chain.run_sample),
    "instruct": (chain.Instruct, chain.run_instruct),
    "replay": (rollouts.Replay, rollouts.run_replay),
    "render": (rollouts.Render, rollouts.run_render),
    "export": (rollouts.Export, rollouts.run_export),
    "convert": (convert.Convert, convert.run_convert),
    "restore": (restore.Restore, restore.run),
    "robots": (robots.Robots, robots.run_robots),
    "mix": (mix.Mix, mix.run),
    "ablate": (ablate.Ablate, ablate.run),
    "push": (push.Push, push.run_push),
    "verify": (look.Verify, look.run_verify),
    "report": (look.Report, look.run_report),
    "doctor": (look.Doctor, look.run_doctor),
}

DESCRIPTION = """Turn scanned buildings into cross-embodiment VLN datasets with simulated robots.

`vlnpe collect` runs the whole pipeline; every stage can also be run on its own. Exit codes:
0 success, 1 more items quarantined than --max-failed allows, 2 invalid input."""


# Next to the bytecode of Python and numba; matplotlib's default is the user's home directory.
FONT_LIST_FOLDER = Path(__file__).parent / "__pycache__" / "matplotlib"


def parse(arguments: Sequence[str] | None = None) -> Any:
    """Return the options of the subcommand on the command line; exit with code 2 on misuse."""
    verbs = [
        Annotated[options, tyro.conf.subcommand(name=verb, prefix_name=False)]
        for verb, (options, _) in VERBS.items()
    ]
    return tyro.cli(
        Union[tuple(verbs)],  # type: ignore[arg-type]  # noqa: UP007 - built at run time
        prog="vlnpe",
        description=DESCRIPTION,
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.FlagConversionOff)[:1],
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand and return the exit code."""
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    os.environ.setdefault("MPLCONFIGDIR", str(FONT_LIST_FOLDER))
    options = parse(arguments)
    run = next(run for record, run in VERBS.values() if isinstance(options, record))
    try:
        return run(options)
    except InputError as error:
        _complain(error)
        return 2
    except OSError as error:
        _complain(f"cannot use {error.filename or 'a file'}: {error.strerror or error}")
        return 2
    except VlnpeError as error:
        _complain(error)
        return 1
    except KeyboardInterrupt:
        _complain("interrupted; run the same command again to resume")
        return 130


def _complain(message: object) -> None:
    line = " ".join(str(message).split())
    sys.stderr.write(f"vlnpe: error: {line}\n")


if __name__ == "__main__":
    sys.exit(main())
