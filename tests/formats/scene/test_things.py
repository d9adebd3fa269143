"""Which labels are words for things that an instruction may use."""

import pytest

from vlnpe.formats.scene.things import nameable


@pytest.mark.parametrize("name", ["sofa", "kitchen table", "TV", "trash can", "book_shelf shelf"])
def test_things(name: str) -> None:
    assert nameable(name)


@pytest.mark.parametrize(
    "name",
    ["", "wall standard case", "wall", "nursesstation", "chunk b", "window frame", "table 3",
     "building element proxy", "furnishing element", "slab", "big red old kitchen table"],
)  # fmt: skip
def test_no_things(name: str) -> None:
    assert not nameable(name)
