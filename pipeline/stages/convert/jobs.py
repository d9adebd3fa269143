"""Convert one recorded episode, or a dataset of them, into another format."""

import json
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ....formats.convert.episodes import (
    DATASET_NAME,
    dataset_from_units,
    mcap_from_unit,
    unit_from_dataset,
    unit_from_mcap,
)
from ....formats.convert.facts import DatasetFacts
from ....formats.internnav.foreign import Assumptions
from ....formats.internnav.reader import SceneFolder, read_dataset_facts
from ....formats.internnav.to_unit import unit_from_layout
from ....formats.internnav.writer import SceneEpisode, write_scene
from ....formats.lerobot import read_episode_unit
from ....formats.ros2.topic_map import TopicMap
from ....formats.vlnce.vocabulary import Vocabulary
from ...engine.work import ItemResult, digest


class Kind(StrEnum):
    """Formats of recorded episodes."""

    MCAP = "mcap"
    LEROBOT = "lerobot"
    N1 = "n1"
    ROS2 = "ros2"


@dataclass(frozen=True)
class Options:
    """How to convert.

    Attributes:
        licence: For data that does not state its own.
        vocabulary: VLN-CE episode file whose words give InternNav's tokens; None: our own words.
        assumptions: What InternData-N1 does not state.
        scan: InternData-N1's folder to write, one of `layout.SCANS`; None: as the robot says.
        every_frame: InternData-N1 gets a row per frame instead of one per discrete step.
        topics: What the topics of a robot's log hold.
        instruction: For logs that hold none.
        texts: Episode of a log and its instruction, whatever the log holds.
    """

    licence: str
    vocabulary: Path | None
    assumptions: Assumptions
    scan: str | None = None
    every_frame: bool = False
    topics: TopicMap = field(default_factory=TopicMap)
    instruction: str = ""
    texts: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class McapUnitJob:
    """Write the unit of one MCAP file.

    Attributes:
        path: MCAP file.
        out: unit folder.
    """

    path: Path
    out: Path

    def run(self) -> ItemResult:
        """Write an MCAP file's unit."""
        unit_from_mcap(self.path, self.out)
        return ItemResult(unit_facts(self.out, self.path))


@dataclass(frozen=True)
class DatasetUnitJob:
    """Write the unit of one episode of a LeRobot dataset.

    Attributes:
        root: the dataset.
        number: episode index.
        out: unit folder.
    """

    root: Path
    number: int
    out: Path

    def run(self) -> ItemResult:
        """Write the unit of one episode of a LeRobot dataset."""
        unit_from_dataset(self.root, self.number, self.out)
        return ItemResult(unit_facts(self.out, self.root))


@dataclass(frozen=True)
class LayoutUnitJob:
    """Write the unit of one episode of InternData-N1.

    Attributes:
        number: episode index.
        out: unit folder.
    """

    scene: SceneFolder
    number: int
    out: Path
    name: str
    options: Options

    def run(self) -> ItemResult:
        """Write the unit of one episode of InternData-N1."""
        options = self.options
        seen = unit_from_layout(self.scene, self.number, self.out, options.assumptions)
        facts = read_dataset_facts(self.scene.folder)
        if facts is None:
            provenance = {"converted": source_note(Kind.N1) | options.assumptions.note()}
            facts = DatasetFacts(self.name, options.licence, provenance).to_json()
        (self.out / DATASET_NAME).write_text(json.dumps(facts))
        return ItemResult(unit_facts(self.out, self.scene.folder) | asdict(seen))


@dataclass(frozen=True)
class UnitsDatasetJob:
    """Join units into a LeRobot dataset.

    Attributes:
        out: the dataset's folder.
    """

    units: tuple[Path, ...]
    out: Path
    facts: DatasetFacts

    def run(self) -> ItemResult:
        """Assemble a LeRobot dataset."""
        summary = dataset_from_units(self.units, self.out, self.facts)
        return ItemResult({"episodes": summary.episodes, "frames": summary.frames})


@dataclass(frozen=True)
class UnitMcapJob:
    """Write a unit's MCAP file.

    Attributes:
        unit: unit folder.
        out: MCAP file.
    """

    unit: Path
    out: Path

    def run(self) -> ItemResult:
        """Write a unit's MCAP file."""
        mcap_from_unit(self.unit, self.out)
        return ItemResult({"bytes": self.out.stat().st_size})


@dataclass(frozen=True)
class N1SceneJob:
    """Write one scene in InternData-N1's layout.

    Attributes:
        dataset: facts of the dataset the episodes come from, if known.
        every_frame: one row per frame instead of one per discrete step.
        out: the scene's folder.
    """

    episodes: tuple[SceneEpisode, ...]
    vocabulary: Vocabulary
    dataset: dict[str, Any] | None
    every_frame: bool
    out: Path

    def run(self) -> ItemResult:
        """Write the scene."""
        frames = write_scene(
            self.out, self.episodes, self.vocabulary, self.dataset, self.every_frame
        )
        return ItemResult({"episodes": len(self.episodes), "frames": frames})


def unit_facts(folder: Path, source: Path) -> dict[str, Any]:
    """Return what the ledger keeps of a unit."""
    unit = read_episode_unit(folder)
    return {
        "source": str(source),
        "robot": unit.robot,
        "frames": unit.length,
        "alike": digest(unit.frames_per_second, unit.robot, unit.features),
    }


def source_note(kind: Kind) -> dict[str, Any]:
    """Return where units came from, for the provenance."""
    return {"from": str(kind), "vlnpe": version("vlnpe")}
