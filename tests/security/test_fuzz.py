"""The fuzzer of `make bench`: it finds planted faults, and a little of it runs here."""

from pathlib import Path

import pytest

from benchmarks.fuzz.search import refuses, search
from benchmarks.fuzz.targets import TARGETS, Target
from vlnpe.formats.core.errors import InputError

pytestmark = pytest.mark.chain

# Those that start at once; the others load large libraries or write a dataset first.
QUICK = ("glb", "gltf", "obj", "ply", "labels", "house", "vlnce", "recipe", "robot-onnx", "npz")


@pytest.mark.parametrize("name", QUICK)
def test_changed_files_end_in_a_result_or_a_typed_error(name: str, tmp_path: Path) -> None:
    target = TARGETS[name](tmp_path)
    assert not any(refuses(target, seed) for seed in target.seeds)
    inputs, refused = search(target, 60, 5, tmp_path / "current")
    assert inputs >= 50
    assert refused, "no change damaged anything"


def test_a_planted_fault_comes_out_as_its_smallest_input(tmp_path: Path) -> None:
    def read(data: bytes) -> None:
        if b"nan" in data:
            raise KeyError("a")
        raise InputError("refused")

    current = tmp_path / "current"
    with pytest.raises(KeyError):
        search(Target([b"mass 12.5 length 3"], read), 500, 0, current)
    assert b"nan" in current.read_bytes()


def test_long_messages_are_faults() -> None:
    def read(data: bytes) -> None:
        raise InputError("x" * len(data))

    assert refuses(Target([b""], read), b"short")
    with pytest.raises(AssertionError, match="10000 characters"):
        refuses(Target([b""], read), b"x" * 10_000)
