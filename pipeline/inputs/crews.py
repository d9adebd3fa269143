"""The robots of a run: which ones take part under which controllers, and copies of a user's own."""

import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

from ...collectors.controllers import CONTROLLERS, SpeedConfig, valid_controllers
from ...collectors.controllers.speed import SpeedController
from ...collectors.robots import ROBOTS, TIMESTEP_S, RobotSpec, get_robot
from ...collectors.robots.folder.load import folder_digest
from ...collectors.robots.folder.safety import folder_files
from ...formats.core.atomic import atomic_folder
from ...formats.core.errors import InputError, check_name
from ...formats.core.rollout import FORWARD_STEP_M, TURN_STEP_RAD
from ..engine.ledger import Ledger
from .robot_copies import FOLDER

ALL, AUTO = "all", "auto"
# A robot and the name of its controller.
Crew = tuple[RobotSpec, str]
USUAL = "path"  # what `auto` means for whatever has a body


def chosen_robots(text: str) -> list[RobotSpec]:
    """Return the robots of `--robot <text>`: a name, a folder of a user's robot, several, or `all`.

    A bodyless agent is no robot: it takes part only when it is named, also beside `all`.
    """
    # Late, because policies are run by a library that takes its time to load.
    from ...collectors.locomotion.runtime.drives import gait_for

    bodies = [name for name, robot in ROBOTS.items() if robot.joints]
    robots = [get_robot(name) for name in listed_names("--robot", text, bodies)]
    for robot in robots:
        gait_for(robot)  # says at once when its policy is missing, broken or another robot's
    by_name = {robot.name: robot for robot in robots}
    for robot in robots:
        alike = [r for r in by_name.values() if r.name.casefold() == robot.name.casefold()]
        if len(alike) > 1 or alike[0].folder != robot.folder:
            raise InputError(f"--robot {text}: two robots are named {robot.name}; rename one")
    return list(by_name.values())


def chosen_robot(text: str) -> RobotSpec:
    """Return the robot of `--robot <text>`, of a command that takes one; see `chosen_robots`."""
    robots = chosen_robots(text)
    if len(robots) != 1:
        raise InputError(f"--robot {text}: valid: one robot")
    return robots[0]


def crews(robots: Iterable[RobotSpec], text: str) -> list[Crew]:
    """Return each robot with each controller of `--controller <text>` that can drive it.

    `text` is a name, names with commas, `all`, or `auto`: path, and flash for what has no joints
    and therefore cannot be driven, only placed.
    """
    names = [] if text == AUTO else listed_names("--controller", text, CONTROLLERS)
    for name in names:
        if name == AUTO:
            raise InputError(f"--controller {text}: {AUTO} stands alone")
        check_name("controller", name, (*CONTROLLERS, ALL, AUTO))
    result = []
    for robot in robots:
        valid = valid_controllers(robot)
        able = [n for n in names or [auto_controller(robot)] if n in valid]
        if not able:
            raise InputError(
                f"--controller {text}: {robot.name} has no joints to drive; valid for it: "
                f"{', '.join(valid)}"
            )
        result += [(robot, name) for name in able]
    return result


def auto_controller(
    robot: RobotSpec, among: Sequence[str] = tuple(CONTROLLERS), usual: str = USUAL
) -> str:
    """Return what `auto` means: `usual`, or the first controller of `among` that drives `robot`.

    If none of them does, return the first, whose error message then lists the valid ones.
    """
    valid = valid_controllers(robot)
    able = [name for name in among if name in valid] or list(among)
    return usual if usual in able else able[0]


def action_timing(steps: int, closed_loop: bool) -> SpeedConfig:
    """Return how discrete actions are executed: for `steps` physics steps, or until done.

    The speed asked for is what 0.25 m or 15° in so many steps need, within the robot's limits.
    """
    least = round(1.0 / (SpeedController.rate_hz * TIMESTEP_S))  # between two looks of it
    if steps < least or steps % least:
        raise InputError(f"--action-steps {steps}; valid: multiples of {least} (VLN-PE uses 50)")
    seconds = steps * TIMESTEP_S
    return SpeedConfig(
        linear_m_s=FORWARD_STEP_M / seconds,
        yaw_rad_s=TURN_STEP_RAD / seconds,
        steps_per_action=steps,
        end_on_displacement=closed_loop,
    )


def listed_names(option: str, text: str, everything: Iterable[str] = (ALL,)) -> list[str]:
    """Return the comma-separated names in `text`, each once, with `all` expanded."""
    given = [part.strip() for part in text.split(",")]
    if not all(given):
        raise InputError(
            f"{option} {text}: contains an empty name; valid: a name, or a,b,c, or {ALL}"
        )
    spelled = [name for part in given for name in (everything if part == ALL else (part,))]
    return list(dict.fromkeys(spelled))


def keep(robot: RobotSpec, root: Path) -> RobotSpec:
    """Return a robot as a run uses it: one from a folder is copied to `<root>/robots/<name>`."""
    if robot.folder is None:
        return robot
    copy = root / FOLDER / robot.name
    if not copy.is_dir() or folder_digest(copy) != robot.content_sha256:
        with atomic_folder(copy) as temporary:
            for path in folder_files(robot.folder):
                target = temporary / path.relative_to(robot.folder)
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(path, target)
    return get_robot(str(copy))


def keep_crews(pairs: Iterable[Crew], ledger: Ledger) -> list[Crew]:
    """Return crews whose robots are those of a run's folder, with records of their files."""
    local = [(keep(robot, ledger.root), controller) for robot, controller in pairs]
    ledger.record({robot.folder for robot, _ in local if robot.folder is not None})
    return local
