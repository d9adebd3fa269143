"""`make dataset-bench`: the dataset that learned baselines are trained and tested on.

Generated apartments, villas and houses in their exact geometry, some to train in and others that no
training sees. The physical robots walk the paths under `--controller`, the bodyless agent under
flash. The command can be interrupted and repeated, and grown: more scenes, robots or controllers
later keep what is there, as long as `--paths` and `--image` stay the same.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from vlnpe.collectors.robots import ROBOTS
from vlnpe.pipeline.cli import main as vlnpe

KINDS = ("apartment", "villa", "house")
FIRST_UNSEEN_SEED = 1000
# Of each training scene's paths, one in nine is held out as val_seen.
SEEN_SHARE = 9
WIDEST_M = max(robot.footprint_radius_m for robot in ROBOTS.values())


def scenes(train: int, unseen: int) -> str:
    """Return what `--scene` takes: kinds in turn, training scenes first."""
    groups = ((0, train), (FIRST_UNSEEN_SEED, unseen))
    return ",".join(
        f"builtin-exact:{KINDS[k % len(KINDS)]}@{first + k // len(KINDS)}"
        for first, count in groups
        for k in range(count)
    )


def splits(train: int, unseen: int, paths: int) -> str:
    """Return what `--splits` takes: so many paths in every scene."""
    held_out = paths // SEEN_SHARE
    wanted = {
        "train": train * (paths - held_out),
        "val_seen": train * held_out,
        "val_unseen": unseen * paths,
    }
    return ",".join(f"{split}={count}" for split, count in wanted.items() if count)


def main(arguments: list[str] | None = None) -> int:
    """Collect the dataset; return the first exit code that is not 0."""
    parser = argparse.ArgumentParser(prog="make dataset-bench", description=__doc__)
    parser.add_argument("--train", type=int, default=40, help="number of training scenes")
    parser.add_argument("--unseen", type=int, default=10, help="number of unseen scenes")
    parser.add_argument("--paths", type=int, default=36, help="paths per scene")
    parser.add_argument("--image", type=int, default=128, help="width and height of images [px]")
    parser.add_argument("--robot", default="h1,aliengo,jetbot,vlnce", help="comma-separated")
    parser.add_argument("--controller", default="speed", help="of robots with a body")
    parser.add_argument("--out", type=Path, default=Path("runs/dataset-bench"))
    options, more = parser.parse_known_args(arguments)
    if options.train < 1 or options.unseen < 0 or options.paths < 1:
        parser.error("--train and --paths must be at least 1, --unseen at least 0")
    common = [
        "collect",
        f"--scene={scenes(options.train, options.unseen)}",
        f"--splits={splits(options.train, options.unseen, options.paths)}",
        f"--train-scenes={options.train}",
        "--allow-fewer",
        f"--robot-radius-m={WIDEST_M}",
        f"--camera=ego:{options.image}x{options.image}",
        "--no-mcap",
        f"--out={options.out}",
        *more,
    ]
    names = options.robot.split(",")
    bodies = [name for name in names if name not in ROBOTS or ROBOTS[name].joints]
    agents = [name for name in names if name not in bodies]
    code = 0
    for group, controller in ((bodies, options.controller), (agents, "flash")):
        if group:
            robots = ",".join(group)
            code = code or vlnpe([*common, f"--robot={robots}", f"--controller={controller}"])
    return code


if __name__ == "__main__":
    sys.exit(main())
