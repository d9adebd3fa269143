"""What a gait may see of its robot's state."""

from typing import Literal

# The simulation's own, or an estimate from what the robot's sensors measure (`runtime.sensors`).
State = Literal["true", "estimated"]
