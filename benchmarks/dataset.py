"""`make dataset-bench`: the dataset that learned baselines are trained and tested on.

Generated apartments, villas and houses, in their exact geometry unless they are to be scanned: some
to train in, whose walks lie in OUT/training, and others that no training sees, whose scenes and
episodes lie in OUT/unseen. The physical robots walk the paths under `--controller`, the bodyless
agent under flash. The command can be interrupted and repeated, and grown: more scenes, robots or
controllers later keep what is there, as long as `--kinds`, `--paths` and `--image` stay the same.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from vlnpe.collectors.robots import ROBOTS
from vlnpe.formats.core.errors import did_you_mean
from vlnpe.pipeline.cli import main as vlnpe

EXACT, SCANNED = "builtin-exact", "builtin"
KINDS = ("apartment", "villa", "house")
FIRST_UNSEEN_SEED = 1000
TRAINING, UNSEEN = "training", "unseen"  # folders of --out
# Of each training scene's paths, one in nine is held out as val_seen.
SEEN_SHARE = 9
QUARANTINED = 1  # exit code of a run that put something into quarantine
WIDEST_M = max(robot.footprint_radius_m for robot in ROBOTS.values())


def scenes(first: int, count: int, kinds: Sequence[str], scheme: str = EXACT) -> str:
    """Return what `--scene` takes: kinds in turn, each with consecutive seeds."""
    return ",".join(
        f"{scheme}:{kinds[k % len(kinds)]}@{first + k // len(kinds)}" for k in range(count)
    )


def splits(train: int, paths: int) -> str:
    """Return what `--splits` takes for training scenes of so many paths each."""
    held_out = paths // SEEN_SHARE
    counts = {"train": train * (paths - held_out), "val_seen": train * held_out}
    return ",".join(f"{split}={count}" for split, count in counts.items() if count)


def main(arguments: list[str] | None = None) -> int:
    """Collect the dataset; return the worst exit code.

    What a run put into quarantine is counted there, and the other runs go on.
    """
    parser = argparse.ArgumentParser(prog="make dataset-bench", description=__doc__)
    parser.add_argument("--train", type=int, default=40, help="number of training scenes")
    parser.add_argument("--unseen", type=int, default=10, help="number of unseen scenes")
    parser.add_argument("--kinds", default=",".join(KINDS), help="of buildings, in turn")
    parser.add_argument("--paths", type=int, default=36, help="paths per training scene")
    parser.add_argument("--unseen-paths", type=int, default=24, help="paths per unseen scene")
    parser.add_argument("--image", type=int, default=128, help="width and height of images [px]")
    parser.add_argument("--robot", default="h1,aliengo,jetbot,vlnce", help="comma-separated")
    parser.add_argument("--controller", default="speed", help="of robots with a body")
    parser.add_argument("--scanned", action="store_true", help="scan and repair the buildings")
    parser.add_argument("--out", type=Path, default=Path("runs/dataset-bench"))
    options, more = parser.parse_known_args(arguments)
    if options.train < 1 or options.unseen < 0 or min(options.paths, options.unseen_paths) < 1:
        parser.error("--train and paths must be at least 1, --unseen at least 0")
    kinds = options.kinds.split(",")
    if unknown := set(kinds) - set(KINDS):
        named = ", ".join(f"{kind}{did_you_mean(kind, KINDS)}" for kind in sorted(unknown))
        parser.error(f"--kinds: {named}; valid: {', '.join(KINDS)}")
    scheme = SCANNED if options.scanned else EXACT
    common = [
        "collect",
        "--allow-fewer",
        f"--robot-radius-m={WIDEST_M}",
        f"--camera=ego:{options.image}x{options.image}",
        "--no-mcap",
        *more,
    ]
    training = [
        *common,
        f"--scene={scenes(0, options.train, kinds, scheme)}",
        f"--splits={splits(options.train, options.paths)}",
        f"--train-scenes={options.train}",
        f"--out={options.out / TRAINING}",
    ]
    unseen = [
        *common,
        f"--scene={scenes(FIRST_UNSEEN_SEED, options.unseen, kinds, scheme)}",
        f"--splits=val_unseen={options.unseen * options.unseen_paths}",
        "--only-episodes",
        f"--out={options.out / UNSEEN}",
    ]
    names = options.robot.split(",")
    bodies = [name for name in names if name not in ROBOTS or ROBOTS[name].joints]
    agents = [name for name in names if name not in bodies]
    runs = [unseen] if options.unseen else []
    for group, controller in ((bodies, options.controller), (agents, "flash")):
        if group:
            runs.append([*training, f"--robot={','.join(group)}", f"--controller={controller}"])
    code = 0
    for run in runs:
        if code <= QUARANTINED:
            code = max(code, vlnpe(run))
    return code


if __name__ == "__main__":
    sys.exit(main())
