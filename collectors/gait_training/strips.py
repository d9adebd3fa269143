"""Film strips of a gait to look at: walking, turning, standing still."""

from __future__ import annotations

from pathlib import Path

from ..locomotion.policy import GaitPolicy
from ..rendering.people.pictures import save_picture
from ..rendering.people.portraits import walking_strip
from ..rendering.people.studio import make_studio
from ..stroll import SPEED_M_S, stroll

COMMANDS = {
    "walk": (SPEED_M_S, 0.0, 0.0),
    "turn": (0.0, 0.0, 0.8),
    "stand": (0.0, 0.0, 0.0),
}


def write_strips(policy: GaitPolicy, folder: Path) -> list[Path]:
    """Write `<robot>-walk.png`, `-turn.png` and `-stand.png` into `folder`; return their paths."""
    studio, written = make_studio(policy.robot), []
    for name, command in COMMANDS.items():
        policy.reset()
        picture = walking_strip(studio, policy.robot, stroll(policy.robot, command, policy))
        written.append(folder / f"{policy.robot.name}-{name}.png")
        save_picture(written[-1], picture)
    return written
