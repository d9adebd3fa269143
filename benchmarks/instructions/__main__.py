"""Run it: python -m benchmarks.instructions --scenes FOLDER [--scans FOLDER]
    [RUN…] [--out result.json]

The corpus (`corpus/*.json`) is measured by parts on the scenes in FOLDER; generated buildings that
are missing there need no scan. Each RUN is a folder with scenes/<scene>,
episodes/sampled/<scene>.json.gz and facts/<scene>.seen.json, as `vlnpe collect` writes them; the
composer is measured on it.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from .composed import composed, load
from .corpus import PARTS, measure, read_corpus


def main() -> None:
    """Print the results as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="*", type=Path)
    parser.add_argument("--scenes", type=Path)
    parser.add_argument("--scans", type=Path)
    parser.add_argument("--part", choices=PARTS, action="append")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    result: dict[str, Any] = {}
    for part in (options.part or PARTS) if options.scenes else ():
        result[part] = measure(read_corpus(options.scenes, options.scans, (part,)))
    paths = [sample for run in options.runs for sample in load(run)]
    if paths:
        result["composer"] = composed(paths)
    text = json.dumps(result, indent=1, ensure_ascii=False)
    if options.out:
        options.out.write_text(text + "\n")
    sys.stdout.write(text + "\n")


if __name__ == "__main__":
    main()
