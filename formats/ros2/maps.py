"""The maps of a walk as OccupancyGrid, and as the files that Nav2's map server loads."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.records import Schema
from numpy.typing import NDArray

from ..mcap.camera_streams import message_class
from ..mcap.shown import BLOCKED, FREE, ShownTopic
from .messages import header, make, pose, time

UNKNOWN_CELL, FREE_CELL, OCCUPIED_CELL = -1, 0, 100
# Grey values for the thresholds below; Nav2's own value for unknown, 205, lies under its threshold.
UNKNOWN_GREY, FREE_GREY, OCCUPIED_GREY = 128, 254, 0


@dataclass(frozen=True)
class WalkMap:
    """A map, that of the level on which the robot is.

    Attributes:
        from_s: it holds from this time on [s].
        cells: (rows along y, columns along x) int8: free, occupied or unknown.
        cell_m: Edge of a cell [m].
        origin_m: (3,) corner of the first cell in the frame `map` [m].
    """

    from_s: float
    cells: NDArray[np.int8]
    cell_m: float
    origin_m: NDArray[np.float64]

    @staticmethod
    def all_of(shown: ShownTopic) -> "tuple[WalkMap, ...]":
        """Return the maps in a topic that `map_topic` gave, in order."""
        schema = Schema(1, shown.schema_data, "protobuf", shown.schema_name)
        read = message_class(schema).FromString
        return tuple(WalkMap._of(1e-9 * at, read(data)) for at, data in shown.messages)

    @staticmethod
    def _of(from_s: float, grid: Any) -> "WalkMap":
        colors = np.frombuffer(grid.data, np.uint8).reshape(-1, grid.column_count, 4)
        cells = np.full(colors.shape[:2], UNKNOWN_CELL, np.int8)
        cells[(colors == FREE).all(axis=-1)] = FREE_CELL
        cells[(colors == BLOCKED).all(axis=-1)] = OCCUPIED_CELL
        corner = grid.pose.position
        origin = np.array([corner.x, corner.y, corner.z])
        return WalkMap(from_s, cells, grid.cell_size.x, origin)

    def message(self, at_ns: int, frame: str) -> Any:
        """Return an OccupancyGrid."""
        rows, columns = self.cells.shape
        place = pose(self.origin_m, np.array([1.0, 0.0, 0.0, 0.0]))
        info = make("nav_msgs/MapMetaData", time(at_ns), self.cell_m, columns, rows, place)
        return make("nav_msgs/OccupancyGrid", header(at_ns, frame), info, self.cells.ravel())

    def write(self, folder: Path, name: str) -> None:
        """Write `<name>.pgm` and `<name>.yaml`."""
        grey = np.full(self.cells.shape, UNKNOWN_GREY, np.uint8)
        grey[self.cells == FREE_CELL] = FREE_GREY
        grey[self.cells == OCCUPIED_CELL] = OCCUPIED_GREY
        image = cv2.imencode(".pgm", np.flipud(grey))[1]  # its first row is the farthest along y
        (folder / f"{name}.pgm").write_bytes(image.tobytes())
        x, y, _ = self.origin_m.tolist()
        (folder / f"{name}.yaml").write_text(
            f"image: {name}.pgm\nmode: trinary\nresolution: {self.cell_m}\n"
            f"origin: [{x}, {y}, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"
        )


def write_maps(folder: Path, maps: Sequence[WalkMap]) -> None:
    """Write the files of each map: `map`, then `map_2` and so on; one that comes again has one."""
    apart: list[WalkMap] = []
    for entry in maps:
        same = (np.array_equal(entry.cells, old.cells) for old in apart)
        if not any(same):
            apart.append(entry)
            entry.write(folder, "map" if len(apart) == 1 else f"map_{len(apart)}")
