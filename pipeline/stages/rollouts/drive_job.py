"""Make the rollout of a drive from its journal."""

from dataclasses import dataclass, replace
from pathlib import Path

from ....collectors.driving.drive import replay_drive
from ....formats.core.episode import Episode
from ...engine.work import ItemResult
from .replay_job import Walker, open_level, store


@dataclass(frozen=True)
class DriveJob:
    """Repeat a drive in physics and record it.

    Attributes:
        driver: the person's name.
        models: folder where compiled models are kept.
    """

    scene: Path
    episode: Episode
    walker: Walker
    journal: Path
    driver: str
    models: Path
    out: Path

    def run(self) -> ItemResult:
        """Repeat one drive.

        Raises:
            FileFormatError: the journal is damaged or has no end, or physics gives other states.
            DivergedError: physics exploded.
        """
        world = open_level(self.scene, self.episode, self.walker, self.models)
        rollout = replay_drive(world, self.episode, self.walker.config, self.journal, self.driver)
        result = store(rollout, self.scene.name, self.walker.config, self.out)
        return replace(result, facts={**result.facts, "driver": self.driver})
