"""LeRobot folders: templates and names of info.json, links, false counts, NaN, recursion."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.formats.convert.test_convert import ASSEMBLY
from tests.security.hostile import DEEP_JSON, not_files, put, refusal
from tests.support.lerobot_data import write_units
from vlnpe.datasets.episode_index import read_index
from vlnpe.datasets.episode_reader import EpisodeReader
from vlnpe.datasets.local import open_dataset as open_with_lerobot
from vlnpe.formats.convert.dataset import open_dataset
from vlnpe.formats.convert.episodes import unit_from_dataset
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.lerobot import assemble_dataset, read_episode_unit
from vlnpe.formats.video.stream import probe_video

RGB = "observation.images.rgb"


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("sound")
    assemble_dataset(write_units(root, (1.0,)), root / "set", **ASSEMBLY)
    return root / "set"


@pytest.fixture
def dataset(sound: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(sound, tmp_path / "set"))


def convert(root: Path) -> None:
    """What `vlnpe convert` does."""
    for number in open_dataset(root).episodes:
        unit_from_dataset(root, number, root.parent / "out" / "unit")


def load(root: Path) -> None:
    """What the loaders do."""
    index = read_index(root)
    entry = index.entry(0)
    reader = EpisodeReader(index)
    reader.rows(entry, ["observation.state"])
    reader.rgb(entry)


READERS = pytest.mark.parametrize("read", [convert, load])


@READERS
def test_the_sound_dataset_is_read(read: Callable[[Path], None], dataset: Path) -> None:
    read(dataset)


def retold(root: Path, **changes: Any) -> None:
    path = root / "meta" / "info.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


TEMPLATES = [
    "../secret/{chunk_index}.parquet",
    "data/../../secret",
    "/etc/passwd",
    "C:\\secret",
    "\\\\host\\share",
    "{chunk_index.__class__}",
    "{chunk_index.__class__.__mro__[1].__subclasses__}",
    "{chunk_index[0]}",
    "{0}",
    "{}",
    "{root}",
    "{chunk_index!r}",
    "{chunk_index:99999999999d}",
    "{chunk_index:{file_index}}",
    "{chunk_index",
    "data\0x",
    5,
    ["data"],
    {"a": "b"},
    "x" * 100_000 + "{",
]


@pytest.mark.parametrize("template", TEMPLATES)
@pytest.mark.parametrize("key", ["data_path", "video_path"])
@pytest.mark.parametrize("read", [convert, load, open_with_lerobot])
def test_templates_that_lead_out_or_look_inside_are_refused(
    read: Callable[[Path], None], key: str, template: Any, dataset: Path
) -> None:
    retold(dataset, **{key: template})
    assert key in refusal(lambda: read(dataset)).reason


@pytest.mark.parametrize(
    "name", ["../../x", "/x", "a/b", "a\\b", "..", ".x", "", "a\0b", "x" * 300]
)
@READERS
def test_feature_names_are_plain(read: Callable[[Path], None], name: str, dataset: Path) -> None:
    """They become names of files that are written."""
    info = json.loads((dataset / "meta" / "info.json").read_text())
    retold(dataset, features=info["features"] | {name: info["features"][RGB]})
    assert "feature" in refusal(lambda: read(dataset)).reason


@pytest.mark.parametrize(
    "change",
    [
        {"fps": float("nan")},
        {"fps": float("inf")},
        {"fps": 0},
        {"fps": -4},
        {"fps": "4"},
        {"fps": True},
        {"fps": 10**400},
        {"features": []},
        {"features": {RGB: 5}},
        {"features": {RGB: {"dtype": "video", "shape": [10**9, 10**9, 3]}}},
        {"features": {RGB: {"dtype": "video", "shape": [-1, 2, 3]}}},
        {"features": {RGB: {"dtype": ["video"], "shape": [2, 2, 3]}}},
        {"features": {RGB: {"dtype": "video", "shape": "9"}}},
        {"features": json.loads('{"a":' * 200 + "5" + "}" * 200)},
    ],
)
@READERS
def test_numbers_and_shapes_are_checked(
    read: Callable[[Path], None], change: dict[str, Any], dataset: Path
) -> None:
    retold(dataset, **change)
    refusal(lambda: read(dataset))


@pytest.mark.parametrize(
    "change",
    [
        {"total_episodes": 10**12},
        {"total_episodes": -1},
        {"total_episodes": "1"},
        {"total_episodes": None},
        {"chunks_size": "many"},
        {"chunks_size": float("inf")},
        {"data_files_size_in_mb": [1]},
        {"robot_type": ["x"]},
        {"codebase_version": "v" * 100_000},
        {"features": {}},
    ],
)
def test_what_conversion_relies_on_is_checked(change: dict[str, Any], dataset: Path) -> None:
    retold(dataset, **change)
    refusal(lambda: convert(dataset))


@pytest.mark.parametrize("text", [DEEP_JSON, "{", "[]", "\xff", "9" * 5000, ""])
@READERS
def test_damaged_info_is_named(read: Callable[[Path], None], text: str, dataset: Path) -> None:
    (dataset / "meta" / "info.json").write_text(text, "latin-1")
    refusal(lambda: read(dataset))


def a_file(root: Path, pattern: str) -> Path:
    return next(p for p in sorted(root.glob(pattern)) if p.is_file())


PLACES = {
    "info": "meta/info.json",
    "episodes": "meta/episodes/*/*.parquet",
    "rows": "data/*/*.parquet",
    "video": f"videos/{RGB}/*/*.mp4",
    "card": "README.md",
}


@not_files
@pytest.mark.parametrize("place", ["info", "episodes", "rows", "video"])
@READERS
def test_only_regular_files_are_read(
    read: Callable[[Path], None], place: str, kind: str, dataset: Path
) -> None:
    path = a_file(dataset, PLACES[place])
    path.unlink()
    put(kind, path)
    refusal(lambda: read(dataset))


@pytest.mark.parametrize("place", PLACES)
@READERS
def test_links_out_of_the_folder_are_refused(
    read: Callable[[Path], None], place: str, dataset: Path, tmp_path: Path
) -> None:
    path = a_file(dataset, PLACES[place])
    shutil.move(path, tmp_path / "secret")
    path.symlink_to(tmp_path / "secret")
    assert "leads out of" in refusal(lambda: read(dataset)).reason


def test_linked_folders_are_refused(dataset: Path, tmp_path: Path) -> None:
    shutil.move(dataset / "videos", tmp_path / "elsewhere")
    (dataset / "videos").symlink_to(tmp_path / "elsewhere")
    for read in (convert, load, open_with_lerobot):
        assert "leads out of" in refusal(lambda read=read: read(dataset)).reason


def test_a_kept_rollout_may_not_be_a_link(dataset: Path, tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("secret")
    (dataset / "rollouts").mkdir()
    (dataset / "rollouts" / "episode_000000.mcap").symlink_to(tmp_path / "secret")
    refusal(lambda: convert(dataset))


def changed(root: Path, name: str, values: pa.Array) -> None:
    path = a_file(root, PLACES["episodes"])
    table = pq.read_table(path)
    pq.write_table(table.set_column(table.schema.names.index(name), name, values), path)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("data/chunk_index", pa.array([10**15])),
        ("data/chunk_index", pa.array([-1])),
        ("data/chunk_index", pa.array(["../../x"])),
        ("data/chunk_index", pa.array([None], pa.int64())),
        (f"videos/{RGB}/file_index", pa.array(["../../x"])),
        (f"videos/{RGB}/from_timestamp", pa.array([float("nan")])),
        (f"videos/{RGB}/from_timestamp", pa.array([1e300])),
        ("length", pa.array([10**15])),
        ("length", pa.array([-5])),
    ],
)
@READERS
def test_false_places_are_named(
    read: Callable[[Path], None], name: str, values: pa.Array, dataset: Path
) -> None:
    changed(dataset, name, values)
    refusal(lambda: read(dataset))


@READERS
def test_tables_that_grow_are_refused(
    read: Callable[[Path], None], dataset: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = a_file(dataset, PLACES["episodes"])
    pq.write_table(pq.read_table(path).take(pa.array([0] * 5_000)), path)
    monkeypatch.setenv("VLNPE_LIMITS", "table_bytes=20000")
    assert "bytes in memory" in refusal(lambda: read(dataset)).reason


PLAYLISTS = {
    "HLS": "#EXTM3U\n#EXT-X-TARGETDURATION:5\n#EXTINF:5,\n{target}\n#EXT-X-ENDLIST\n",
    "concat": "ffconcat version 1.0\nfile {target}\n",
    "SDP": "v=0\no=- 0 0 IN IP4 127.0.0.1\nc=IN IP4 127.0.0.1\nm=video 9 RTP/AVP 96\n",
}


@pytest.mark.parametrize("kind", PLAYLISTS)
@pytest.mark.parametrize("target", ["rgb.mp4", "http://127.0.0.1:9/x.mp4", "file:///etc/passwd"])
def test_videos_that_refer_to_others_are_refused(
    kind: str, target: str, sound: Path, tmp_path: Path
) -> None:
    shutil.copyfile(a_file(sound, PLACES["video"]), tmp_path / "rgb.mp4")
    path = tmp_path / "list.mp4"
    path.write_text(PLAYLISTS[kind].format(target=target))
    refusal(lambda: probe_video(path))


@pytest.mark.parametrize(
    ("part", "damaged", "reason"),
    [
        (b"avc1", b"zzzz", "codec is unknown"),
        (b"VideoHandler", b"VideoHa\xffdler", "metadata is not text"),
        (b"vide", b"soun", "no video stream"),
    ],
)
@READERS
def test_damaged_headers_of_videos_are_named(
    read: Callable[[Path], None], part: bytes, damaged: bytes, reason: str, dataset: Path
) -> None:
    path = a_file(dataset, PLACES["video"])
    content = path.read_bytes()
    assert part in content
    path.write_bytes(content.replace(part, damaged))
    assert reason in refusal(lambda: read(dataset)).reason


def test_feature_names_that_leave_the_unit_are_refused(tmp_path: Path) -> None:
    (unit,) = write_units(tmp_path, (0.0,))
    index = json.loads((unit / "unit.json").read_text())
    index["features"]["../../x"] = index["features"][RGB]
    (unit / "unit.json").write_text(json.dumps(index))
    with pytest.raises(FileFormatError, match="feature"):
        read_episode_unit(unit)
