"""Kernels take in what they call; numba's other functions are compiled as ever."""

import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from vlnpe.formats.process.kernel import called, kernel


@called()
def _checked(value):
    if value < 0.0:
        raise ValueError("a negative value", value)
    return max(value, 1.0)


@numba.njit
def doubled(value):
    return 2.0 * value


@kernel()
def quadrupled(value):
    return 2.0 * doubled(value)


@kernel()
def _inner(values):
    return np.sort(values)


@kernel(3)
def _outer(values):
    result = np.zeros(len(values))
    for k, value in enumerate(_inner(values)):
        result[k] = _checked(value)
    return result


def test_results_and_errors_of_what_a_kernel_calls_come_through() -> None:
    for _ in range(2):
        np.testing.assert_array_equal(_outer(np.array([3.0, 0.5, 2.0])), [1.0, 2.0, 3.0])
        with pytest.raises(ValueError, match="a negative value") as error:
            _outer(np.array([1.0, -1.0]))
        assert error.value.args[1] == -1.0
    np.testing.assert_array_equal(_inner(np.array([2.0, 1.0])), [1.0, 2.0])


def test_functions_compiled_after_kernels_have_code_of_their_own() -> None:
    _outer(np.ones(1))
    njit = numba.njit

    @njit
    def doubled(values):
        result = np.zeros(len(values))
        for k, value in enumerate(np.sort(values)):
            result[k] = 2.0 * max(value, 1.0)
        return result

    np.testing.assert_array_equal(doubled(np.array([3.0, 0.5])), [2.0, 6.0])
    assert len(doubled.overloads) == 1


CODE = """
from tests.formats.process import test_kernel as t
t.test_results_and_errors_of_what_a_kernel_calls_come_through()
print(t.quadrupled(3.0), t.doubled(3.0), *(sum(k.stats.cache_hits.values()) for k in (
    t._outer, t.quadrupled)))
"""


def test_a_new_process_runs_kernels_from_the_cache_and_plain_functions_from_python(
    tmp_path: Path,
) -> None:
    outputs = [
        subprocess.run(
            [sys.executable, "-c", CODE],
            cwd=Path(__file__).parents[3],
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
            timeout=300,
        ).stdout.split()
        for _ in range(2)
    ]
    assert outputs == [["12.0", "6.0", "0", "0"], ["12.0", "6.0", "1", "1"]]
