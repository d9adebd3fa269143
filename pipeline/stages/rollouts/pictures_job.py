"""Images and videos for the report, and preview videos."""

from dataclasses import dataclass
from pathlib import Path

from ....collectors.robots import RobotSpec
from ....formats.core.atomic import write_json
from ....formats.mcap.rollout import read_rollout
from ....formats.rendered.folder import read_frame_folder
from ....rendering.camera.views import View
from ....rendering.figures.film_strip import film_strip
from ....rendering.figures.pictures import save_picture, third_person_clip, watchable_video
from ....rendering.figures.scene_map import top_down_map
from ...engine.work import ItemResult
from ...execution.parts import telling
from ..scenes.renderer import scene_renderer


@dataclass(frozen=True)
class MapJob:
    """Draw one level from above, and write the image's position in the world beside it."""

    scene: Path
    level: int
    out: Path

    def run(self) -> ItemResult:
        """Render one level from above."""
        bundle, renderer = scene_renderer(self.scene)
        picture = top_down_map(bundle, renderer, self.level)
        height, width = picture.image.shape[:2]
        mapping = {
            "left_m": picture.left_m,
            "top_m": picture.top_m,
            "px_per_m": picture.px_per_m,
            "width": width,
            "height": height,
        }
        write_json(self.out.with_suffix(".json"), mapping)
        save_picture(self.out, picture.image)
        return ItemResult()


@dataclass(frozen=True)
class StripJob:
    """Show one rendered episode as a strip of images."""

    scene: Path
    rollout: Path
    robot: RobotSpec
    frames: Path
    out: Path

    def run(self) -> ItemResult:
        """Draw the strip."""
        walked = read_rollout(self.rollout)
        seen = read_frame_folder(self.frames)
        _, renderer = scene_renderer(self.scene)
        film_strip(self.out, renderer, walked, seen, self.robot)
        camera = seen.camera
        facts = {
            "robot": walked.robot,
            "controller": walked.controller,
            "kind": camera.name,
            "camera": f"{camera.width_px} × {camera.height_px} px, {camera.hfov_deg:g}°",
            "light": seen.light,
            "episode": walked.episode.episode_id,
            "end_reason": str(walked.end_reason),
        }
        return ItemResult(facts)


@dataclass(frozen=True)
class ClipJob:
    """Show the last seconds of one episode as a video, and its last frame as an image.

    Attributes:
        seconds: how much of the end is shown [s].
    """

    scene: Path
    rollout: Path
    robot: RobotSpec
    seconds: float
    out: Path

    def run(self) -> ItemResult:
        """Render the clip."""
        _, renderer = scene_renderer(self.scene)
        walked = read_rollout(self.rollout)
        last = third_person_clip(self.out, renderer, walked, self.seconds, robot=self.robot)
        save_picture(self.out.with_suffix(".jpg"), last)
        return ItemResult()


@dataclass(frozen=True)
class FilmJob:
    """Render one rollout as a preview video."""

    scene: Path
    rollout: Path
    robot: RobotSpec
    view: View
    frames_per_second: int
    out: Path

    def run(self) -> ItemResult:
        """Render the video."""
        _, renderer = scene_renderer(self.scene, self.view.renderer, self.view.light)
        recorded = read_rollout(self.rollout)
        self.out.parent.mkdir(parents=True, exist_ok=True)
        fps = self.frames_per_second
        with telling(self.out) as tell:
            count = watchable_video(
                self.out, renderer, recorded, self.view, fps, robot=self.robot, on_part=tell
            )
        return ItemResult({"frames": count, "scene": self.scene.name})
