"""Look for changes of a sound file, drawn by Hypothesis, that a reader does not stand.

An input must end in a result or in a typed error of one short line. Anything else is a finding:
another exception, or more than `SECONDS`.
"""

import re
import signal
import struct
import time
from pathlib import Path
from types import FrameType

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import seed as seeded
from hypothesis import strategies as st

from benchmarks.fuzz.targets import Target
from vlnpe.formats.core.errors import VlnpeError

SECONDS = 20
MAX_MESSAGE = 2000
_WORD = re.compile(rb"-?\d[\d.e+-]*|[A-Za-z_:./]+")
_NUMBERS = (0, 1, 255, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1)
PIECES = (
    b"nan", b"inf", b"-1", b"0", b"1", b"4294967295", b"99999999999999999999", b"1e400", b"-0.0",
    b"", b"../a", b"/etc/passwd", b"[", b"]", b"{", b"}", b"null", b"true", b'"', b'""', b"[]",
    b"{}", b"[[[[0]]]]", b"\0", b"\\", b"\xff", b"*a", b"&a", b"{0.__class__}", b"\n", b" ",
    b"<a>", b"9" * 400, b"[" * 300, b"x" * 5000,
    *(struct.pack(order + "Q", n)[-8:] for n in _NUMBERS for order in "<>"),
    *(struct.pack(order + "I", n % 2**32) for n in _NUMBERS for order in "<>"),
)  # fmt: skip


@st.composite
def changed(draw: st.DrawFn, seeds: list[bytes]) -> bytes:
    """Return a strategy of sound files in which up to four pieces are replaced."""
    data = draw(st.sampled_from(seeds))
    for _ in range(draw(st.integers(1, 4))):
        piece = draw(st.one_of(st.sampled_from(PIECES), st.binary(max_size=8)))
        words = [word.span() for word in _WORD.finditer(data, 0, 20_000)]
        if words and draw(st.booleans()):
            start, end = draw(st.sampled_from(words))
        else:
            far = min(len(data), draw(st.sampled_from((200, len(data)))))  # headers come first
            start = draw(st.integers(0, far))
            # Over as many bytes, which keeps the layout of binary files, or not.
            over = st.just(start + len(piece))
            end = draw(over | st.integers(start, start + 20) | st.just(len(data)))
        data = data[:start] + piece + data[end:]
    return data


def refuses(target: Target, data: bytes) -> bool:
    """Return whether a reader refuses an input; raise any error but a short typed one."""
    signal.signal(signal.SIGALRM, _too_slow)
    signal.alarm(SECONDS)
    try:
        target.read(data)
    except VlnpeError as error:
        text = str(error)
        if len(text) > MAX_MESSAGE or "\n" in text:
            raise AssertionError(f"message of {len(text)} characters: {text[:500]!r}") from error
        return True
    except (Exception, KeyboardInterrupt):
        raise
    except BaseException as error:  # e.g. a panic of a library in Rust
        raise RuntimeError(repr(error)) from error
    finally:
        signal.alarm(0)
    return False


def search(
    target: Target, examples: int, seed: int, current: Path, end: float = float("inf")
) -> tuple[int, int]:
    """Return how many changed files were read and how many of them were refused.

    Args:
        current: file that holds each input while it is read; after an error, the smallest that
            Hypothesis came to.
        end: value of `time.monotonic` at which to stop.
    """
    counts = [0, 0]

    @seeded(seed)
    @settings(
        max_examples=examples,
        deadline=None,
        database=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
        phases=(Phase.generate, Phase.shrink),
        report_multiple_bugs=False,
    )
    @given(changed(target.seeds))
    def read(data: bytes) -> None:
        if time.monotonic() > end:
            return
        current.write_bytes(data)
        counts[0] += 1
        counts[1] += refuses(target, data)

    read()
    return counts[0], counts[1]


def _too_slow(number: int, frame: FrameType | None) -> None:
    raise TimeoutError(f"more than {SECONDS} s")
