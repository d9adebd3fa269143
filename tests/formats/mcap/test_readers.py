"""Readers that are not ours find everything in our MCAP files by their indexes and checksums."""

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.records import Chunk, DataEnd, Footer, Header
from mcap.stream_reader import StreamReader

from tests.formats.mcap.test_episode import small_map, write_frame_folder
from tests.support.rollouts import make_rollout
from vlnpe.formats.mcap.episode import write_episode_mcap
from vlnpe.formats.mcap.shown import map_topic

SCRIPT = Path(__file__).parents[2] / "support" / "read_mcap.js"
PACKAGES = ("@mcap/core", "fzstd")
TOPICS = {"/map": 1, "/plan": 1, "/state": 401, "/action": 17, "/events": 3}
SHOWN = ("/tf", "/base/pose", "/joint_states", "/command", "/imu", "/foot_contact")
TOPICS |= dict.fromkeys(SHOWN, 81)
TOPICS |= {f"/camera/{name}": 17 for name in ("tf", "calibration", "rgb", "depth")}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("written")
    rollout = make_rollout(4.0, discrete=True)
    write_frame_folder(root / "frames", rollout)
    write_episode_mcap(
        root / "a.mcap", rollout, root / "frames", shown=(map_topic((0.0, small_map())),)
    )
    return root / "a.mcap"


def test_every_record_is_indexed_and_has_a_checksum(written: Path) -> None:
    with written.open("rb") as file:
        records = list(StreamReader(file, emit_chunks=True, validate_crcs=True).records)
    chunks = [record for record in records if isinstance(record, Chunk)]
    assert chunks and all(c.uncompressed_crc and c.compression == "zstd" for c in chunks)
    (end,) = [record for record in records if isinstance(record, DataEnd)]
    (footer,) = [record for record in records if isinstance(record, Footer)]
    assert end.data_section_crc and footer.summary_crc and footer.summary_offset_start
    assert isinstance(records[0], Header)
    with written.open("rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
    assert summary is not None and summary.statistics is not None
    assert len(summary.chunk_indexes) == len(chunks)
    indexed = set().union(*(index.message_index_offsets for index in summary.chunk_indexes))
    assert indexed == set(summary.channels)
    assert [a.name for a in summary.attachment_indexes] == ["frames.npz"]
    metadata = sorted(m.name for m in summary.metadata_indexes)
    assert metadata == ["vlnpe.instruction", "vlnpe.rollout", "vlnpe.view"]
    assert summary.statistics.message_count == sum(TOPICS.values())


def test_a_time_range_of_one_topic_is_found_by_the_index(written: Path) -> None:
    with written.open("rb") as file:
        content = make_reader(file, validate_crcs=True).iter_messages(
            "/camera/rgb", starting_at=1_000_000_000, ending_before=2_000_000_000
        )
        times = [message.log_time for *_, message in content]
    assert times == [1_000_000_000 + 250_000_000 * k for k in range(4)]


@pytest.fixture(scope="module")
def node(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Environment in which node finds @mcap/core; nothing is downloaded for it."""
    if shutil.which("node") is None:
        pytest.skip("node is not installed")
    environment = dict(os.environ)
    probe = ["node", "-e", "".join(f"require.resolve('{p}');" for p in PACKAGES)]
    if subprocess.run(probe, env=environment, capture_output=True).returncode == 0:
        return environment
    root = tmp_path_factory.mktemp("npm")
    if shutil.which("npm") is not None:
        options = ["--offline", "--no-audit", "--no-fund", "--ignore-scripts", "--prefix", "."]
        install = ["npm", "install", *options, *PACKAGES]
        if subprocess.run(install, cwd=root, capture_output=True).returncode == 0:
            return environment | {"NODE_PATH": str(root / "node_modules")}
    pytest.skip(
        f"neither NODE_PATH nor npm's cache has {' and '.join(PACKAGES)}; "
        f"`npm install --prefix DIR {' '.join(PACKAGES)}`, then NODE_PATH=DIR/node_modules"
    )


def read_by_node(path: Path, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    # A script lies where it lies; its packages come from NODE_PATH.
    return subprocess.run(
        ["node", str(SCRIPT), str(path)], env=environment, capture_output=True, text=True
    )


def test_npms_reader_finds_the_same(written: Path, node: dict[str, str]) -> None:
    done = read_by_node(written, node)
    assert done.returncode == 0, done.stderr
    content: dict[str, Any] = json.loads(done.stdout)
    assert content["done"] and content["ordered"]
    assert content["topics"] == TOPICS
    assert content["compressions"] == ["zstd"]
    assert content["attachments"]["frames.npz"] > 0
    rollout = json.loads(content["metadata"]["vlnpe.rollout"]["json"])
    assert rollout["episode"]["instruction"] == content["metadata"]["vlnpe.instruction"]["text"]
    assert content["records"]["Message"] == sum(TOPICS.values())
    assert content["records"]["ChunkIndex"] == content["records"]["Chunk"]


def test_npms_reader_notices_a_flipped_bit(
    written: Path, node: dict[str, str], tmp_path: Path
) -> None:
    damaged = bytearray(written.read_bytes())
    damaged[len(damaged) // 2] ^= 1
    (tmp_path / "b.mcap").write_bytes(damaged)
    assert read_by_node(tmp_path / "b.mcap", node).returncode == 1
