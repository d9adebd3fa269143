"""Small datasets of several robots for loaders, mixtures and ablations, by our own writer."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from tests.support.lerobot_data import write_unit
from tests.support.rollouts import make_rollout, with_body
from vlnpe.formats.core.rollout import Rollout
from vlnpe.formats.lerobot import assemble_dataset

WORDS = ("Walk past the table.", "Turn left at the sofa.", "Go to the lamp and stop.")


def make_walk(number: int, robot: str, seconds: float, fall: bool = False) -> Rollout:
    """Return a walk along its own trajectory, with one of three instructions, by `number`."""
    rollout = make_rollout(seconds, number, discrete=robot == "vlnce", fall=fall)
    body = {"h1": (10, 2), "jetbot": (2, 2), "vlnce": (0, 1)}.get(robot)
    rollout = with_body(rollout, *body) if body else rollout
    words = WORDS[number % 3]
    episode = replace(
        rollout.episode,
        episode_id=f"ep{number}",
        trajectory_id=f"traj{number}",
        scene_id=f"scene{number % 4}",
        instruction=words,
        extra={"instructions": [words]},
    )
    controller = "flash" if robot == "vlnce" else "path"
    return replace(rollout, robot=robot, controller=controller, episode=episode)


def write_dataset(
    root: Path,
    robot: str,
    seconds: Sequence[float],
    falls: Sequence[int] = (),
    rate: int = 4,
    camera: str = "ego",
    hfov_deg: float = 90.0,
) -> Path:
    """Write `root/lerobot/<robot>`, an episode for each of `seconds`; those in `falls` fall.

    Views of other cameras lie in `root/lerobot/<robot>-<camera>`, or `-<hfov_deg>`.
    """
    name = robot if camera == "ego" else f"{robot}-{camera}"
    name += "" if hfov_deg == 90.0 else f"-{hfov_deg:g}"
    folder = root / "units" / name
    folder.mkdir(parents=True)
    units = [
        write_unit(
            folder,
            make_walk(n, robot, s, n in falls),
            n,
            rate,
            camera_name=camera,
            hfov_deg=hfov_deg,
        )
        for n, s in enumerate(seconds)
    ]
    out = root / "lerobot" / name
    assemble_dataset(units, out, provenance={}, licence="mit", title=robot)
    return out
