"""Write an episode as a bag of ROS 2."""

from dataclasses import dataclass
from pathlib import Path

from ....formats.convert.unit_ros2 import ros2_from_unit
from ...engine.work import ItemResult


@dataclass(frozen=True)
class UnitRos2Job:
    """Write a unit's bag.

    Attributes:
        unit: Unit folder.
        urdf: The robot's model, if it is known.
        out: The bag's folder, replaced as a whole.
    """

    unit: Path
    urdf: str | None
    out: Path

    def run(self) -> ItemResult:
        """Write the bag."""
        ros2_from_unit(self.unit, self.out, self.urdf)
        return ItemResult({"bytes": sum(path.stat().st_size for path in self.out.iterdir())})
