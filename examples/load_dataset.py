"""Read episodes of a LeRobot dataset without torch: python examples/load_dataset.py DATASET."""

import sys
from pathlib import Path

from vlnpe.datasets.episode_index import read_index
from vlnpe.datasets.episode_reader import EpisodeReader
from vlnpe.formats.core.errors import InputError


def main(dataset: Path) -> None:
    index = read_index(dataset)
    reader = EpisodeReader(index)  # size_px=64 would return smaller pictures
    for number in range(len(index)):
        entry = index.entry(number)
        rgb, depth_m = reader.rgbd(entry, 0, 1)  # (1, H, W, 3) uint8, (1, H, W) float32 [m]
        velocity = reader.rows(entry, ["action.velocity"])["action.velocity"]
        print(f"episode {number}: {len(velocity)} frames, rgb {rgb.shape}, depth {depth_m.shape}")


if __name__ == "__main__":
    try:
        main(Path(*sys.argv[1:]))
    except InputError as error:
        sys.exit(f"{error}\n{__doc__}")
