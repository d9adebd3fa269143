"""GLB containers: round trips, and files that are cut off."""

import json
from pathlib import Path

import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from vlnpe.formats.untrusted.glb import glb_bytes, read_glb

TREES = st.dictionaries(st.text(max_size=5), st.integers() | st.text(max_size=9), max_size=4)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(TREES, st.binary(max_size=40), st.integers(1, 30))
def test_chunks_return_as_written_and_cut_files_raise(
    tmp_path: Path, tree: dict[str, object], body: bytes, cut: int
) -> None:
    path = tmp_path / "a.glb"
    data = glb_bytes(tree, body)
    assert len(data) % 4 == 0
    path.write_bytes(data)
    text, back = read_glb(path)
    assert json.loads(text) == tree
    assert bytes(back) == body + bytes(-len(body) % 4)
    path.write_bytes(data[: -min(cut, len(data))])
    try:
        read_glb(path)
    except ValueError:
        return
    # What is cut off is the whole binary chunk.
    assert len(body)
    assert cut == 8 + len(body) + -len(body) % 4


def test_trimesh_reads_a_file_without_a_binary_chunk(tmp_path: Path) -> None:
    path = tmp_path / "a.glb"
    path.write_bytes(glb_bytes({"asset": {"version": "2.0"}, "scenes": [{}], "scene": 0}, b""))
    assert not trimesh.load_scene(path).geometry


def test_a_foreign_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.glb"
    path.write_bytes(b"ply\nformat ascii 1.0\n")
    with pytest.raises(ValueError, match="no glTF signature"):
        read_glb(path)
