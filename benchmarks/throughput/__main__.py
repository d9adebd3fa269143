"""Measure one part of a collection and print the section with everything measured so far.

python -m benchmarks throughput                     # all of it, into benchmarks/README.md
python -m benchmarks.throughput parts --robot h1    # one part, printed
python -m benchmarks.throughput runs --scene small_house --robot aliengo --workers 2
"""

import argparse
import sys

from benchmarks.throughput.page import keep, section
from benchmarks.throughput.parts import measure_parts
from benchmarks.throughput.runs import EPISODES, ROBOTS, SCENES, measure_run


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("kind", choices=("parts", "runs"))
    parser.add_argument("--scene", choices=[*SCENES], default="small_house")
    parser.add_argument("--robot", choices=ROBOTS, default="aliengo")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--episodes", type=int, default=EPISODES)
    chosen = parser.parse_args(arguments)
    if chosen.kind == "parts":
        keep("parts", measure_parts(chosen.scene, chosen.robot))
    else:
        run = measure_run(chosen.scene, chosen.robot, chosen.workers, chosen.episodes)
        keep("runs", run)
    sys.stdout.write(section() + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
