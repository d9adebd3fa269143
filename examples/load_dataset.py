"""Read episodes of a LeRobot dataset without torch: python examples/load_dataset.py DATASET."""

import sys
from pathlib import Path

from vlnpe.datasets.episode_index import read_index
from vlnpe.datasets.episode_reader import EpisodeReader


def main(dataset: Path) -> None:
    index = read_index(dataset)
    reader = EpisodeReader(index, size_px=64)
    for number in range(len(index)):
        entry = index.entry(number)
        rgb, depth_m = reader.rgbd(entry, 0, 1)  # (1, 64, 64, 3) uint8, (1, 64, 64) float32 [m]
        velocity = reader.rows(entry, ["action.velocity"])["action.velocity"]
        print(f"episode {number}: {len(velocity)} frames, rgb {rgb.shape}, depth {depth_m.shape}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
