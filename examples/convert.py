"""Convert one episode of a dataset to MCAP: python examples/convert.py DATASET NUMBER OUT.mcap."""

import sys
import tempfile
from pathlib import Path

from vlnpe.formats.convert.episodes import mcap_from_unit, unit_from_dataset


def main(dataset: Path, number: int, out: Path) -> None:
    with tempfile.TemporaryDirectory() as temporary:
        unit = Path(temporary) / "unit"  # the form between all formats
        unit_from_dataset(dataset, number, unit)
        mcap_from_unit(unit, out)
    print(f"{out}: {out.stat().st_size} bytes; open it in Foxglove")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]))
