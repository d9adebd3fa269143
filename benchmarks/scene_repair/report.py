"""The benchmark's report, section by section."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .cases import Case
from .fillers import table as filler_table
from .scenes import HEADSETS, HELD_OUT_SEEDS, HOUSE, TUNING_SEEDS
from .speed import PICTURE, TARGET_TRIANGLES, Run
from .speed import report as speed_report
from .store import Result, repair_code
from .tables import by_kind, missed, summary
from .walk import ROBOT, RUN_UP_M, Walk
from .walk import table as walk_table

Done = tuple[Case, Result]

TUNING, HELD_OUT, REAL = "Built-in apartments", "Held-out apartments", "Real scans"
INTRODUCTION = """# How good is the repair?

Written by `python -m benchmarks.scene_repair` (`--complete` runs everything that this page has).

{machine}

Holes of known outline are cut into the triangles of floors that are known, and the repaired scene
is measured by vertical rays against its exported triangles, in the source's own frame. What was
scanned stays byte for byte. Holes are round, long cracks, slivers between tiles, concave (L and U),
rings around an island, at walls, under furniture and across thresholds; some rims are cut exactly,
some torn along whole triangles. Decoys are built, not only cut: stairs down to a landing, walled
shafts with or without doorway and bottom, courtyards between walls under the open sky, atria behind
balustrades. The area of a hole is the floor that went: what lay beneath a wall does not count.
A point is filled if there is a surface within 2.5 cm of the true floor; a hole, if 98 % of its
points are; a decoy, if 2 % are. Real scans' truth is their floor before it was cut.
"""
WANTED = {TUNING: len(TUNING_SEEDS), HELD_OUT: len(HELD_OUT_SEEDS)}
TEXTS = {
    TUNING: "The virtual scans of {count} homes whose plan is known exactly, by seed {first} … "
    "{last}. Their true floor is the plane z = 0, rugs apart; besides the planted holes they have "
    "the gaps that scanning leaves under and behind furniture. Textures are painted coarser than "
    "the product does, which no hole depends on.",
    HELD_OUT: "{count} homes (seeds {first} … {last}) that nobody looked at while the repair was "
    "written.",
    REAL: f"`{HOUSE}`, planted {{rounds}} times, and {len(HEADSETS)} headset scans of single "
    "rooms, whose closed surface is floor where it is level within 2 cm of the labelled room's "
    "floor.",
}


def group_section(title: str, done: Sequence[Done]) -> list[str]:
    """What became of one group of scenes."""
    if not done:
        return [f"## {title}", "", "Not run.", ""]
    scores = [result.score for _, result in done]
    seeds = [case.seed for case, _ in done]
    text = TEXTS[title].format(
        count=len(done),
        first=min(seeds),
        last=max(seeds),
        rounds=sum(case.scene == HOUSE for case, _ in done),
    )
    if title in WANTED and len(done) < WANTED[title]:
        text += f" **So far {len(done)} of {WANTED[title]}.**"
    older = sum(result.code != repair_code() for _, result in done)
    seconds = np.median([result.seconds for _, result in done])
    lines = [f"## {title}", "", text, ""]
    if older:
        lines += [f"{older} of {len(done)} results are of an earlier state of the repair.", ""]
    return [
        *lines,
        *summary(scores),
        "",
        f"Repairing took {seconds:.1f} CPU seconds a scene (median).",
        "",
        *by_kind(scores),
        "",
        "Not as it should be:",
        "",
        *missed(scores),
        "",
    ]


def filler_section(done: Sequence[Done]) -> list[str]:
    """Others on the same scans."""
    compared = [result for _, result in done if result.fillers]
    if not compared:
        return ["## Side by side with other fillers", "", "Not run.", ""]
    ours = [(result.score.holes, result.seconds) for result in compared]
    return [
        "## Side by side with other fillers",
        "",
        f"The same {len(compared)} planted scans, vertices merged, by the same measure; seconds of "
        "the filler alone against everything that `vlnpe repair` does. "
        "`trimesh.repair.fill_holes` knows no size; pyvista's is told the largest planted one.",
        "",
        *filler_table(ours, [f for result in compared for f in result.fillers]),
        "",
    ]


def speed_section(runs: list[Run], folder: Path) -> list[str]:
    """Time and memory."""
    if not runs:
        return ["## Speed", "", "Not run.", ""]
    return [
        "## Speed",
        "",
        "The whole `vlnpe repair`, starting Python included, in a child process on one core. The "
        "smallest scan is one apartment in fewer triangles; then one, two, four and eight "
        "apartments side by side in one file, so that floor, rooms and furniture grow with the "
        f"triangles. Target: {TARGET_TRIANGLES:,} triangles.",
        "",
        *speed_report(runs, folder / PICTURE),
        "",
    ]


def walk_section(found: list[Walk]) -> list[str]:
    """The physical check."""
    if not found:
        return ["## Walking over it", "", "Not run.", ""]
    return [
        "## Walking over it",
        "",
        f"{ROBOT.title()} walks straight lines, {RUN_UP_M} m before and after, over holes in the "
        "open floor of apartments; the line is shifted so that its left or right feet step over "
        "the hole's middle. Both floors are height fields of the exported triangles in steps of "
        "2 cm, half a metre deep where neither a cell nor any of its neighbours has floor, so no "
        "hole is larger than it is; obstacles and planning are the same in both. The floor that "
        "the repair itself hands to the simulator could not serve for the raw scan: it is closed "
        "around scanned cells by design.",
        "",
        *walk_table(found),
        "",
    ]
