"""A unit's episode as a bag of ROS 2."""

from pathlib import Path

from ..core.errors import FileFormatError
from ..lerobot.units.rows import row_arrays
from ..lerobot.units.unit import read_episode_unit
from ..mcap.shown import MAP_TOPIC
from ..ros2.episode import write_bag
from ..ros2.maps import WalkMap
from .episodes import ROLLOUT_NAME, kept_episode
from .frame_rollout import frame_rollout, frame_view
from .stored_depth import depth_video


def ros2_from_unit(folder: Path, out: Path, urdf: str | None = None) -> None:
    """Write a unit's bag: with its whole rollout and its maps if the unit keeps them.

    Args:
        urdf: The robot's model, if it is known.

    Raises:
        FileFormatError: If the unit is damaged, or its rollout is of another episode.
    """
    if (folder / ROLLOUT_NAME).is_file():
        with kept_episode(folder) as (rollout, view, shown):
            topics = [topic for topic in shown if topic.topic == MAP_TOPIC]
            maps = WalkMap.all_of(topics[0]) if topics else ()
            write_bag(out, rollout, view, maps=maps, urdf=urdf)
        return
    unit = read_episode_unit(folder)
    with depth_video(unit) as depth:
        try:
            rows = row_arrays(unit.rows())
            rollout, view = frame_rollout(unit, rows), frame_view(unit, rows, depth)
        except (KeyError, TypeError, ValueError) as error:
            raise FileFormatError(unit.folder, f"unit is damaged: {error!r}") from error
        write_bag(out, rollout, view, urdf=urdf)
