"""Film one episode of an evaluation for its report."""

from dataclasses import dataclass
from pathlib import Path

from ....collectors.robots import RobotSpec
from ....formats.mcap.rollout import read_rollout
from ....rendering.camera.views import View
from ....rendering.figures.pictures import save_picture
from ....rendering.figures.story import policy_film
from ...engine.work import ItemResult
from ...execution.parts import telling
from ..scenes.renderer import scene_renderer


@dataclass(frozen=True)
class PolicyFilmJob:
    """Show what a policy saw and did, with its instruction.

    Attributes:
        out: video; its last frame is beside it as `.jpg`.
    """

    scene: Path
    rollout: Path
    robot: RobotSpec
    view: View
    out: Path

    def run(self) -> ItemResult:
        """Render the film."""
        _, renderer = scene_renderer(self.scene, self.view.renderer, self.view.light)
        self.out.parent.mkdir(parents=True, exist_ok=True)
        rollout = read_rollout(self.rollout)
        with telling(self.out) as tell:
            last = policy_film(self.out, renderer, rollout, self.view, self.robot, on_part=tell)
        save_picture(self.out.with_suffix(".jpg"), last)
        return ItemResult()
