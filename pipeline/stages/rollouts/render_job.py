"""Render a recorded rollout."""

from dataclasses import dataclass, field
from pathlib import Path

from ....collectors.robots import RobotSpec
from ....formats.core.atomic import atomic_folder
from ....formats.vlnce.groups import per_instruction
from ....rendering.camera.extras import Extras
from ....rendering.camera.rollout_views import DEPTH_WRITERS, render_rollout
from ....rendering.camera.views import View
from ...engine.work import ItemResult
from ..scenes.renderer import scene_renderer
from .handover import DepthKeeper, rollout_at


@dataclass(frozen=True)
class RenderJob:
    """Render one rollout into a frame folder.

    Attributes:
        relative: the same, relative to the folder of the ledger that records this item.
        depth_storage: how datasets will store depth, key of `DEPTH_WRITERS`.
        depth: is left the depth codes.
    """

    scene: Path
    rollout: Path
    relative: str
    robot: RobotSpec
    view: View
    frames_per_second: int
    rgb_codec: str
    extras: Extras
    depth_storage: str
    out: Path
    depth: DepthKeeper = field(default_factory=DepthKeeper, compare=False)

    def run(self) -> ItemResult:
        """Render one rollout."""
        bundle, renderer = scene_renderer(self.scene, self.view.renderer, self.view.light)
        recorded = rollout_at(self.rollout)
        with atomic_folder(self.out) as temporary:
            count = render_rollout(
                bundle,
                renderer,
                recorded,
                self.view,
                temporary,
                self.frames_per_second,
                codec=self.rgb_codec,
                robot=self.robot,
                extras=self.extras,
                depth_storage=self.depth_storage,
                on_depth=self.depth.add,
            )
        self.depth.end(self.out / DEPTH_WRITERS[self.depth_storage][0])
        facts = {
            "frames": count,
            "rollout": self.relative,
            "scene": self.scene.name,
            "split": recorded.episode.split,
            "texts": len(per_instruction(recorded.episode)),
            "end_reason": str(recorded.end_reason),
            "frames_per_second": self.frames_per_second,
        }
        return ItemResult(facts)
