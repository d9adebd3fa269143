"""Render a recorded rollout."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from ...collectors.rendering.camera.extras import Extras
from ...collectors.rendering.camera.rollout_views import render_rollout
from ...collectors.rendering.camera.views import View
from ...collectors.rendering.interface import Renderer
from ...collectors.rendering.registry import make_renderer
from ...collectors.robots import get_robot
from ...formats.core.atomic import atomic_folder
from ...formats.mcap.rollout import read_rollout
from ...formats.scene.bundle import SceneBundle, load_bundle
from ..engine.work import ItemResult


@dataclass(frozen=True)
class RenderJob:
    """Render one rollout into a frame folder.

    Attributes:
        scene: folder of the repaired scene.
        rollout: rollout file.
        relative: the same, relative to the folder of the ledger that records this item.
        robot: name or folder.
        view: what to see.
        frames_per_second: of the videos.
        rgb_codec: key of `RGB_CODECS`.
        extras: further videos.
        out: frame folder.
    """

    scene: Path
    rollout: Path
    relative: str
    robot: str
    view: View
    frames_per_second: int
    rgb_codec: str
    extras: Extras
    out: Path

    def run(self) -> ItemResult:
        """Render one rollout."""
        bundle, renderer = scene_renderer(self.scene, self.view.renderer, self.view.light)
        recorded = read_rollout(self.rollout)
        with atomic_folder(self.out) as temporary:
            count = render_rollout(
                bundle,
                renderer,
                recorded,
                self.view,
                temporary,
                self.frames_per_second,
                codec=self.rgb_codec,
                robot=get_robot(self.robot),
                extras=self.extras,
            )
        facts = {
            "frames": count,
            "rollout": self.relative,
            "scene": self.scene.name,
            "end_reason": str(recorded.end_reason),
            "frames_per_second": self.frames_per_second,
        }
        return ItemResult(facts)


@lru_cache(maxsize=1)
def scene_renderer(
    scene: Path, name: str = "embree", light: str = "baked"
) -> tuple[SceneBundle, Renderer]:
    """A repaired scene with its renderer; a worker keeps the last, which takes seconds to load."""
    bundle = load_bundle(scene)
    return bundle, make_renderer(bundle, name, light=light)
