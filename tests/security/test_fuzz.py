"""The fuzzer of `make bench`: it finds planted faults, and a little of it runs here."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.fuzz.engine import _try
from benchmarks.fuzz.mutate import mutated
from benchmarks.fuzz.targets import TARGETS, Target
from vlnpe.formats.core.errors import InputError

pytestmark = pytest.mark.chain

# Those that start at once; the others load large libraries or write a dataset first.
QUICK = ("glb", "gltf", "obj", "ply", "labels", "house", "vlnce", "recipe", "robot-onnx", "npz")


@pytest.mark.parametrize("name", QUICK)
def test_changed_files_end_in_a_result_or_a_typed_error(name: str, tmp_path: Path) -> None:
    target, rng = TARGETS[name](tmp_path), np.random.default_rng(5)
    refused = 0
    for seed in target.seeds:
        assert _try(target, seed) == (False, None)
        for _ in range(60):
            bad, fault = _try(target, mutated(seed, target.seeds, rng))
            refused += bad
            assert fault is None, fault
    assert refused, "no change damaged anything"


def test_faults_are_found_and_named() -> None:
    def read(data: bytes) -> None:
        if data == b"error":
            raise InputError("refused")
        if data == b"long":
            raise InputError("x" * 10_000)
        if data == b"raw":
            raise KeyError("a")

    target = Target([b""], read)
    assert _try(target, b"") == (False, None)
    assert _try(target, b"error") == (True, None)
    for data, what in ((b"long", "10000 characters"), (b"raw", "KeyError")):
        fault = _try(target, data)[1]
        assert fault is not None and what in fault[1]


def test_equal_seeds_change_equally() -> None:
    data = [b'{"a": [1, 2.5, "x"]}', b"v 1 2 3\nf 1 2 3\n"]
    for seed in range(200):
        one, other = (mutated(data[0], data, np.random.default_rng(seed)) for _ in range(2))
        assert one == other
    changed = {mutated(data[0], data, np.random.default_rng(seed)) for seed in range(200)}
    assert len(changed) > 100
