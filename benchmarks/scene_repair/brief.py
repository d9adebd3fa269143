"""The repair's section of `make bench`: a few scenes; the whole takes half an hour or more."""

from __future__ import annotations

from pathlib import Path

from .cases import apartment_case, real_cases, run_case
from .fillers import table as filler_table
from .report import summary

SEEDS = (0, 1)


def report(run: Path) -> str:
    """Plant holes into two apartments and the real scans at hand; a Markdown section.

    Args:
        run: folder for scans, scenes and results.
    """
    cases = [apartment_case(seed, "brief") for seed in SEEDS] + real_cases("brief")[:1]
    results = [run_case(case, True, run / "scene_repair") for case in cases]
    names = ", ".join(case.scene for case in cases)
    return "\n".join(
        [
            "## Scene repair",
            "",
            f"Holes planted into known floors: {names}. The whole is in",
            "[scene_repair/README.md](scene_repair/README.md).",
            "",
            *summary([result.score for result in results]),
            "",
            *filler_table(
                [(result.score.holes, result.seconds) for result in results],
                [filler for result in results for filler in result.fillers],
            ),
            "",
        ]
    )
