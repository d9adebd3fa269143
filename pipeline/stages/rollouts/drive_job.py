"""Make the rollout of a drive from its journal."""

from dataclasses import dataclass, replace
from pathlib import Path

from ....collectors.driving.drive import replay_drive
from ....formats.core.atomic import file_digest
from ....formats.core.episode import Episode
from ....formats.core.errors import FileFormatError
from ....formats.core.rollout import Rollout
from ....formats.mcap.rollout import read_rollout
from ...engine.work import ItemResult
from .replay_job import Walker, open_level, store

JOURNAL = "journal_sha256"  # fact of a rollout


@dataclass(frozen=True)
class DriveJob:
    """Repeat a drive in physics and record it.

    What was recorded before stays as it is, with the episode's words as they are now: nobody can
    drive it again in the physics of another version.

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
        config, digest = self.walker.config, file_digest(self.journal)
        rollout = self._recorded(digest)
        if rollout is None:
            world = open_level(self.scene, self.episode, self.walker, self.models)
            rollout = replay_drive(world, self.episode, config, self.journal, self.driver)
        rollout = replace(rollout, facts={**rollout.facts, JOURNAL: digest})
        result = store(rollout, self.scene.name, config, self.out)
        return replace(result, facts={**result.facts, "driver": self.driver})

    def _recorded(self, digest: str) -> Rollout | None:
        """Return the rollout that was made of this journal before; None if there is none."""
        try:
            rollout = read_rollout(self.out)
        except (FileFormatError, OSError):
            return None
        return (
            replace(rollout, episode=self.episode) if rollout.facts.get(JOURNAL) == digest else None
        )
