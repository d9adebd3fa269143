"""The command line: a table of commands that is true, and help that imports nothing heavy."""

from __future__ import annotations

import inspect
import subprocess
import sys

import pytest

from vlnpe.pipeline.cli import VERBS, main

HEAVY = ("av", "cv2", "lerobot", "matplotlib", "mujoco", "numba", "numpy", "pxr", "scipy", "torch")


@pytest.mark.parametrize("name", VERBS)
def test_table_agrees_with_the_commands(name: str) -> None:
    verb = VERBS[name]
    first = inspect.cleandoc(verb.options().__doc__ or "").split("\n\n")[0]
    assert verb.summary() == " ".join(first.split())
    first_parameter, *_ = inspect.signature(verb.run(), eval_str=True).parameters.values()
    assert first_parameter.annotation is verb.options()


def test_help_imports_nothing_heavy_and_lists_every_command() -> None:
    code = (
        "import sys\nfrom vlnpe.pipeline.cli import main\n"
        "try:\n    main(['--help'])\n"
        f"finally:\n    print('LOADED', *sorted({HEAVY} & sys.modules.keys()))"
    ).replace(str(HEAVY), repr(set(HEAVY)))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    *text, loaded = done.stdout.splitlines()
    assert loaded == "LOADED"
    listed = [line.split()[0] for line in text if line.startswith("    ") and line[4] != " "]
    assert [name for name in listed if name in VERBS] == list(VERBS)


def test_a_command_imports_no_other_command() -> None:
    code = (
        "import sys\nfrom vlnpe.pipeline.cli import main\n"
        "try:\n    main(['filter', '--help'])\n"
        "finally:\n    print(*sorted(m for m in sys.modules if 'pipeline.commands.' in m))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "usage: vlnpe filter" in done.stdout
    assert done.stdout.splitlines()[-1] == "vlnpe.pipeline.commands.chain"


@pytest.mark.parametrize("arguments", [["colect"], [], ["repair"], ["repair", "a", "--sed", "1"]])
def test_bad_calls_exit_with_code_2(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as exit_:
        main(arguments)
    assert exit_.value.code == 2
    assert "vlnpe" in "".join(capsys.readouterr())
