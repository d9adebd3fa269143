"""Write rendered episodes as LeRobot v3."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ....formats.core.errors import VlnpeError
from ....formats.core.licences import licence_id
from ....formats.lerobot import assemble_dataset, write_episode_unit
from ....formats.rendered.folder import read_frame_folder
from ....formats.scene.bundle import load_bundle
from ....formats.vlnce.groups import per_instruction
from ...engine.work import ItemResult
from ...provenance import encoding_facts, episode_facts, provenance
from .reviewed import reviewed_rollout


@dataclass(frozen=True)
class UnitJob:
    """Write one episode's share of a LeRobot dataset.

    Attributes:
        review: what people decided about the instructions, if there is such a file.
        number: which of the path's instructions the unit is of; None keeps all in one unit.
    """

    rollout: Path
    frames: Path
    out: Path
    depth_storage: str
    review: Path
    number: int | None = None

    def run(self) -> ItemResult:
        """Write one episode's LeRobot unit."""
        seen = read_frame_folder(self.frames)
        recorded = reviewed_rollout(self.rollout, self.review)
        if self.number is not None:
            texts = per_instruction(recorded.episode)
            if self.number >= len(texts):
                raise VlnpeError(f"instruction {self.number + 1} was left out in review")
            recorded = replace(recorded, episode=texts[self.number])
        write_episode_unit(self.out, recorded, seen, depth_storage=self.depth_storage)
        facts = {
            "frames": seen.facts["frames"],
            "scene": seen.facts["scene_id"],
            "split": recorded.episode.split,
            "made": episode_facts(recorded),
            "encoding": encoding_facts(seen.facts, self.depth_storage),
        }
        return ItemResult(facts)


@dataclass(frozen=True)
class DatasetJob:
    """Join units into a LeRobot dataset.

    Attributes:
        scenes: folders of the scenes they lie in.
        all_scenes: names of all scenes of the run.
        made: facts of each unit's episode, for the provenance.
        code_sha256: digest of the code that made the episodes and their pixels.
        language: add LeRobot's language column.
    """

    units: tuple[Path, ...]
    scenes: tuple[Path, ...]
    all_scenes: tuple[str, ...]
    out: Path
    made: tuple[Mapping[str, Any], ...]
    encoding: Mapping[str, Any]
    facts: Mapping[str, Any]
    code_sha256: str
    language: bool = False

    def run(self) -> ItemResult:
        """Assemble one dataset."""
        bundles = [load_bundle(scene) for scene in self.scenes]
        licences = sorted({licence_id(str(b.source.get("licence") or "")) for b in bundles})
        summary = assemble_dataset(
            self.units,
            self.out,
            provenance=provenance(
                self.made, bundles, self.all_scenes, self.encoding, self.facts, self.code_sha256
            ),
            licence="-and-".join(licences),
            title=self.out.name,
            language=self.language,
        )
        return ItemResult({"episodes": summary.episodes, "frames": summary.frames})
