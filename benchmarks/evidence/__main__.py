"""`make evidence`: run the recipes that docs/results/data.md rests on with `vlnpe ablate`.

Each recipe in `recipes/` names the command that collects its data. Results go to `results/`, where
the published ones lie; `--draw` writes their pages and figures without measuring anything. With
`--place` the same trainings walk in another run, such as one in a house that others made.
"""

import argparse
import shutil
import sys
from pathlib import Path

from benchmarks.dataset import TRAINING, UNSEEN
from vlnpe.formats.core.errors import VlnpeError, check_name
from vlnpe.pipeline.ablation.page import write_page
from vlnpe.pipeline.ablation.results import RESULTS_NAME, read_results
from vlnpe.pipeline.cli import main as vlnpe

HERE = Path(__file__).resolve().parent
RECIPES = {path.stem: path for path in sorted((HERE / "recipes").glob("*.yaml"))}
BENCH = Path("runs/dataset-bench")  # where `make dataset-bench` writes


def main(arguments: list[str] | None = None) -> int:
    """Measure or draw the recipes that are named; return the exit code."""
    parser = argparse.ArgumentParser(prog="make evidence", description=__doc__)
    parser.add_argument("recipes", nargs="*", help=f"of {', '.join(RECIPES)}; all by default")
    parser.add_argument("--data", type=Path, default=BENCH / TRAINING, help="folder of runs")
    parser.add_argument("--run", type=Path, default=BENCH / UNSEEN, help="run of unseen episodes")
    parser.add_argument("--place", default="", help="name of another --run, for its results")
    parser.add_argument("--out", type=Path, default=Path("runs/evidence"), help="trainings, walks")
    parser.add_argument("--results", type=Path, default=HERE / "results", help="folder of results")
    parser.add_argument("--draw", action="store_true", help="write pages of published results")
    options, more = parser.parse_known_args(arguments)
    try:
        for name in options.recipes:
            check_name("recipe", name, RECIPES)
        for name in options.recipes or RECIPES:
            shown = f"{name}-{options.place}" if options.place else name
            results, out = options.results / f"{shown}.json", options.out / shown
            if not options.draw:
                (options.out / name).mkdir(parents=True, exist_ok=True)
                call = ["ablate", str(RECIPES[name]), "--data", str(options.data)]
                call += ["--run", str(options.run), "--out", str(out)]
                call += ["--trainings", str(options.out / name)]
                call += [] if options.place else ["--split", "val_unseen"]
                if code := vlnpe([*call, *more]):
                    return code
                shutil.copyfile(out / RESULTS_NAME, results)
            write_page(out, read_results(results))
            sys.stdout.write(f"{results}, {out}/report.html\n")
    except VlnpeError as error:
        sys.stderr.write(f"make evidence: error: {error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
