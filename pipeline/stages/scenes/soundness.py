"""Accept or refuse a repaired scene."""

from dataclasses import dataclass

from ....formats.core.errors import SceneError
from ...engine.work import ItemResult


@dataclass(frozen=True)
class SoundnessJob:
    """Accept or refuse a repaired scene.

    Attributes:
        allow_unsound: let it pass all the same.
    """

    scene_id: str
    problems: tuple[str, ...]
    allow_unsound: bool

    def run(self) -> ItemResult:
        """Check one scene."""
        if self.problems and not self.allow_unsound:
            raise SceneError(
                f"{self.scene_id} is not sound: {'; '.join(self.problems)}. Look at after.png and "
                "repair.json in its folder; pass --allow-unsound to collect in it anyway"
            )
        return ItemResult({"problems": list(self.problems)})
