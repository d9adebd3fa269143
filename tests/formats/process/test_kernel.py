"""Kernels take in what they call; numba's other functions are compiled as ever."""

import numba
import numpy as np
import pytest

from vlnpe.formats.process.kernel import called, kernel


@called()
def _checked(value):
    if value < 0.0:
        raise ValueError("a negative value")
    return max(value, 1.0)


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
        with pytest.raises(ValueError, match="a negative value"):
            _outer(np.array([1.0, -1.0]))
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
