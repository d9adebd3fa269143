"""What is to be converted, and stage `unit`: each of its episodes as a unit."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ....formats.convert.dataset import open_dataset
from ....formats.core.errors import FileFormatError, check_name
from ....formats.internnav import layout
from ....formats.internnav.reader import dataset_folders, find_scenes, is_layout
from ....formats.lerobot.info import read_info
from ....formats.trainers.subset import ANNOTATIONS_NAME
from ....formats.untrusted.files import check_input, read_start
from ...engine.work import Job, WorkItem, digest, work_item
from .jobs import DatasetUnitJob, Kind, LayoutUnitJob, McapUnitJob, Options

UNIT_STAGE = "unit"
BAG_METADATA = "metadata.yaml"
# Magic number, a header record's code and 8 bytes of length, the length of the profile, and it.
ROS2_START = b"\x89MCAP0\r\n" + bytes(9) + b"\x04\x00\x00\x00ros2"
LACKS_POSES = (
    "lacks the robot's poses and the times of its frames: it cannot be converted back; convert "
    "the run or dataset that it was written from"
)


@dataclass(frozen=True)
class Source:
    """Where episodes come from.

    Attributes:
        path: what the user gave.
        name: of the dataset that comes out; several scans give several.
    """

    path: Path
    kind: Kind
    name: str


def detect_all(path: Path, whole: bool = False) -> list[Source]:
    """Return what `path` contains: the datasets of a run, or one dataset.

    Args:
        whole: Whether to take a run's MCAP files, which hold whole rollouts, where it has them.

    Raises:
        FileFormatError: nothing that can be converted.
    """
    datasets = sorted(path.glob("lerobot/*/meta/episodes")) if path.is_dir() else []
    if datasets:
        folders = [found.parents[1] for found in datasets]
        recorded = [path / Kind.MCAP / folder.name for folder in folders]
        return [
            detect(other if whole and other.is_dir() else folder)
            for folder, other in zip(folders, recorded, strict=True)
        ]
    return [detect(path)]


def detect(path: Path) -> Source:
    """Return what kind of data `path` contains.

    Raises:
        FileFormatError: nothing that can be converted.
    """
    if not path.is_dir():
        check_input(path)
        if is_ros2_file(path):
            return Source(path, Kind.ROS2, path.resolve().stem)
        if path.suffix != ".mcap":
            raise FileFormatError(path, "neither a folder nor an .mcap file")
        return Source(path, Kind.MCAP, path.resolve().stem)
    name = path.resolve().name
    if (path / "meta" / "episodes").is_dir():
        return Source(path, Kind.LEROBOT, name)
    if bag_paths(path):
        return Source(path, Kind.ROS2, name)
    if any(path.glob("*.mcap")):
        return Source(path, Kind.MCAP, name)
    if is_layout(path):
        return Source(path, Kind.N1, name)
    for folder in dataset_folders(path):
        read_info(folder)  # says which version of LeRobot it is
    if (path / ANNOTATIONS_NAME).is_file():
        raise FileFormatError(path, f"a layout of a trainer, which {LACKS_POSES}")
    raise FileFormatError(
        path,
        "nothing to convert; valid: a run, a folder of .mcap files, a LeRobot v3 dataset, "
        "InternData-N1's VLN-PE layout, bags of ROS 2",
    )


def unit_items(source: Source, units: Path, options: Options) -> dict[str, list[WorkItem]]:
    """Return the items that write units, by the name of the dataset they belong to."""
    groups: dict[str, list[WorkItem]] = {}

    def add(name: str, episode: str, seen: Any, job: Job) -> None:
        out = units / name / episode
        # A log's texts are in its span.
        inputs = (seen, episode, replace(options, instruction="", texts=()))
        item = work_item(UNIT_STAGE, f"{name}/{episode}", job, (out,), *inputs)
        groups.setdefault(name, []).append(item)

    path = source.path.resolve()
    if source.kind is Kind.MCAP:
        for file in [path] if path.is_file() else sorted(path.glob("*.mcap")):
            out = units / source.name / file.stem
            add(source.name, file.stem, _seen([file]), McapUnitJob(file, out))
    elif source.kind is Kind.LEROBOT:
        opened = open_dataset(path)
        # Digested once: the list of a large dataset is long, and it is in every episode's key.
        seen = digest(_seen(f for f in sorted(path.rglob("*")) if f.is_file()))
        for number in opened.episodes:
            episode = f"episode_{number:06d}"
            out = units / source.name / episode
            add(source.name, episode, seen, DatasetUnitJob(path, number, out))
    elif source.kind is Kind.ROS2:
        from .log_job import check_stems, log_items_of  # needs an extra

        bags = bag_paths(path)
        check_stems(bags)
        for bag in bags:
            files = [bag] if bag.is_file() else sorted(bag.iterdir())
            seen = tuple(_seen(files))
            jobs = log_items_of(bag, seen, units / source.name, source.name, options, len(bags) > 1)
            for job in jobs:
                add(source.name, job.out.name, job.inputs, job)
        names = [item.name.rsplit("/", 1)[1] for items in groups.values() for item in items]
        for episode, _ in options.texts:
            check_name("episode in --instruction", episode, names)
    else:
        scenes = find_scenes(path)
        scans = {scene.scan for scene in scenes}
        for scene in scenes:
            name = source.name if len(scans) == 1 else f"{source.name}-{scene.scan}"
            relative = "-".join(scene.folder.resolve().relative_to(path).parts) or scene.scene
            for number in scene.episodes:
                episode = f"{relative}-{number:06d}"
                seen = _seen(_layout_files(scene.folder, number))
                out = units / name / episode
                add(name, episode, seen, LayoutUnitJob(scene, number, out, name, options))
    if not groups:
        raise FileFormatError(source.path, "contains no episodes")
    return groups


def bag_paths(path: Path) -> list[Path]:
    """Return a path that is a bag of ROS 2, or the bags in a folder.

    A recorder that was killed leaves a bag without metadata: its storage files count one by one.
    """
    if not path.is_dir():
        return [path] if is_ros2_file(path) else []
    if _has_metadata(path):
        return [path]
    entries = sorted(path.iterdir())
    return [
        bag
        for entry in entries
        for bag in (
            [entry] if _has_metadata(entry) or not entry.is_dir() else sorted(entry.iterdir())
        )
        if _has_metadata(bag) or is_ros2_file(bag)
    ]


def _has_metadata(path: Path) -> bool:
    return path.is_dir() and (path / BAG_METADATA).exists()


def is_ros2_file(path: Path) -> bool:
    """Return whether a file stores messages of ROS 2."""
    if path.suffix not in (".db3", ".mcap") or not path.is_file():
        return False
    start = read_start(path, len(ROS2_START))
    return path.suffix == ".db3" or start.endswith(ROS2_START[-8:])


def _layout_files(folder: Path, number: int) -> list[Path]:
    names = {"episode_chunk": number // layout.EPISODES_PER_CHUNK, "episode_index": number}
    return [
        folder / layout.DATA_PATH.format(**names),
        *(
            folder / layout.VIDEO_PATH.format(video_key=key, **names)
            for key in (layout.RGB_KEY, layout.DEPTH_KEY)
        ),
        *(
            folder / name
            for name in (
                layout.INFO_PATH,
                layout.TASKS_PATH,
                layout.EPISODES_PATH,
                layout.STATS_PATH,
                layout.UNITS_PATH,
                layout.DATASET_PATH,
            )
        ),
    ]


def _seen(files: Iterable[Path]) -> list[Any]:
    """Return what identifies files without reading gigabytes: their sizes and times."""
    states: list[Any] = []
    for path in files:
        status = path.stat() if path.is_file() else None
        states.append((str(path), *((status.st_size, status.st_mtime_ns) if status else ())))
    return states
