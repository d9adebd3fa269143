"""Progress as another process reads it: few lines in a pipe, a bar on a terminal."""

import os
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest

from vlnpe.formats.process import progress

BARS = """
from vlnpe.formats.process.progress import progress_bar

with progress_bar("walk", 5000, note="done 0") as bar:
    for n in range(5000):
        bar.set_postfix_str(f"done {n + 1}", refresh=False)
        bar.update()
for _ in progress_bar("short", 3, items=range(3)):
    pass
progress_bar("reused", 7, initial=7, note="reused 7").close()
progress_bar("nothing", 0).close()
progress_bar("hidden", 9, show=False).close()
try:
    with progress_bar("broken", 100) as bar:
        bar.update(42)
        bar.update(5)
        raise KeyboardInterrupt
except KeyboardInterrupt:
    pass
"""


def lines_in_a_pipe(short_s: float) -> dict[str, list[list[str]]]:
    """Words of each line of the bars, by name, where one of less than `short_s` is short."""
    code = f"from vlnpe.formats.process import progress\nprogress.SHORT_S = {short_s}\n{BARS}"
    done = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, timeout=120
    )
    assert not done.stdout and "\r" not in done.stderr and "\n\n" not in done.stderr
    output = [line.split() for line in done.stderr.splitlines()]
    return {name: [w for w in output if w[0] == name] for name in {words[0] for words in output}}


def test_a_pipe_gets_one_line_for_a_short_step() -> None:
    by_name = lines_in_a_pipe(short_s=1000.0)
    counts = {name: [words[2] for words in lines] for name, lines in by_name.items()}
    assert counts == {
        "walk": ["5000/5000"],
        "short": ["3/3"],
        "reused": ["7/7"],
        "nothing": ["0/0"],
        "broken": ["47/100"],
    }
    assert by_name["walk"][0][-2:] == ["done", "5000"]


def test_a_long_step_is_named_before_its_first_item_is_done(monkeypatch, capsys) -> None:
    monkeypatch.setattr(progress, "SHORT_S", 0.01)
    output = ""
    with progress.progress_bar("repair", 2) as bar:
        for _ in range(1000):
            if output := output + capsys.readouterr().err:
                break
            time.sleep(0.01)
        bar.update(2)
    output += capsys.readouterr().err
    assert [line.split()[2] for line in output.splitlines()] == ["0/2", "2/2"]


def test_a_pipe_gets_a_line_per_tenth() -> None:
    by_name = lines_in_a_pipe(short_s=0.0)
    walk = by_name["walk"]
    assert [words[1] for words in walk] == [f"{p}%" for p in range(0, 101, 10)]
    assert [words[2] for words in walk][-2:] == ["4500/5000", "5000/5000"]
    assert walk[0][-2:] == ["done", "0"] and walk[-1][-2:] == ["done", "5000"]
    assert [words[2] for words in by_name["short"]] == ["0/3", "1/3", "2/3", "3/3"]
    assert [words[1:3] for words in by_name["reused"]] == [["100%", "7/7"]]
    assert by_name["reused"][0][-2:] == ["reused", "7"]
    assert len(by_name["nothing"]) == 1 and "hidden" not in by_name
    # The count at which it stopped is printed, although no new tenth was reached.
    assert [words[2] for words in by_name["broken"]] == ["0/100", "42/100", "47/100"]


def test_a_slow_bar_is_not_silent_between_tenths(monkeypatch, capsys) -> None:
    clock = iter(range(0, 1000, 7))
    monkeypatch.setattr(progress, "SHORT_S", 0.0)
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    with progress.progress_bar("train", 1000) as bar:
        for _ in range(20):
            bar.update()
    output = [line.split()[2] for line in capsys.readouterr().err.splitlines()]
    assert output[0] == "0/1000" and output[-1] == "20/1000" and 4 <= len(output) <= 8


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here")
@pytest.mark.parametrize(("rows", "columns"), [(24, 120), (24, 80), (0, 0)])
def test_a_terminal_gets_one_bar_that_fits(rows: int, columns: int) -> None:
    import fcntl
    import struct
    import termios

    main, side = os.openpty()
    fcntl.ioctl(side, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
    code = "\n".join(BARS.splitlines()[:7])
    with subprocess.Popen([sys.executable, "-c", code], stderr=side) as process:
        os.close(side)
        output = b""
        try:
            while part := os.read(main, 4096):
                output += part
        except OSError:  # how Linux says that the other end is closed
            pass
    os.close(main)
    assert process.returncode == 0
    assert b"\r" in output and b"100%|" in output and output.count(b"\n") == 1
    assert b"5000/5000" in output and b"done 5000" in output
    lengths = {len(line.decode()) for line in output.replace(b"\n", b"\r").split(b"\r")}
    assert max(lengths) < min(columns or 80, 101)
