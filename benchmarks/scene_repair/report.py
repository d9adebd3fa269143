"""The benchmark's report, section by section."""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from .cases import Case, Result, repair_code
from .planting.shapes import KINDS
from .scenes import HEADSETS, HELD_OUT_SEEDS, HOUSE, TUNING_SEEDS
from .score import COUNTED_FROM_M, HoleScore, Score
from .speed import PICTURE, TARGET_TRIANGLES, Run
from .speed import report as speed_report
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
EXPECTED_SEEDS = {TUNING: len(TUNING_SEEDS), HELD_OUT: len(HELD_OUT_SEEDS)}
TEXTS = {
    TUNING: "The virtual scans of {count} homes whose plan is known exactly, by seed {first} … "
    "{last}. Their true floor is the plane z = 0, rugs apart; besides the planted holes they have "
    "the gaps that scanning leaves under and behind furniture. Textures are painted coarser than "
    "the product does, which no hole depends on.",
    HELD_OUT: "{count} homes (seeds {first} … {last}) that were not looked at while the "
    "repair was written.",
    REAL: f"`{HOUSE}`, planted {{rounds}} times, and {len(HEADSETS)} headset scans of single "
    "rooms, whose closed surface is floor where it is level within 2 cm of the labelled room's "
    "floor.",
}
SIZES_M = (0.03, 0.05, 0.1, 0.2, 0.5, 1.0, 2.6)


def group_section(title: str, done: Sequence[Done]) -> list[str]:
    """Return what became of one group of scenes."""
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
    if title in EXPECTED_SEEDS and len(done) < EXPECTED_SEEDS[title]:
        text += f" **So far {len(done)} of {EXPECTED_SEEDS[title]}.**"
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


def speed_section(runs: list[Run], folder: Path) -> list[str]:
    """Return the time and memory."""
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


def walk_section(walks: list[Walk]) -> list[str]:
    """Return the physical check."""
    if not walks:
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
        *walk_table(walks),
        "",
    ]


def counted(scores: Iterable[Score]) -> list[HoleScore]:
    """Return the planted holes of at least 5 cm."""
    return [
        h
        for s in scores
        for h in s.holes
        if not h.hole.decoy and h.area_m2 > 0 and h.hole.size_m >= COUNTED_FROM_M
    ]


def summary(scores: Sequence[Score]) -> list[str]:
    """Return the figures that the targets speak of, as table rows."""
    holes, decoys = counted(scores), [h for s in scores for h in s.holes if h.hole.decoy]
    errors = 1000 * np.abs(np.concatenate([h.errors_m for h in holes] or [np.empty(0)]))
    natural = 1000 * np.abs(np.concatenate([s.natural_errors_m for s in scores]))
    floor = sum(s.floor_m2 for s in scores)
    area = sum(h.area_m2 for h in holes)
    filled = sum(h.filled_m2 for h in holes)
    whole = sum(h.filled for h in holes)
    rows = [
        ("planted holes of at least 5 cm", f"{len(holes)}, {area:.1f} m²", ""),
        ("planted area filled", f"{100 * filled / max(area, 1e-9):.2f} %", "≥ 99 %"),
        ("planted holes filled", f"{100 * whole / max(len(holes), 1):.2f} %", "≥ 98 %"),
        ("decoys filled", f"{sum(h.filled for h in decoys)} of {len(decoys)}", "0"),
        (
            "floor added outside the building",
            f"{100 * sum(s.outside_m2 for s in scores) / floor:.3f} % of the floor",
            "< 0.1 %",
        ),
        (
            "floor added under walls",
            f"{100 * sum(s.in_walls_m2 for s in scores) / floor:.3f} % of the floor",
            "",
        ),
    ]
    if len(errors):
        rows.append(("patch height error, median", f"{np.median(errors):.2f} mm", "< 5 mm"))
        rows.append(("… 99th percentile", f"{np.percentile(errors, 99):.1f} mm", "< 20 mm"))
    if len(natural):
        before = sum(s.before * s.floor_m2 for s in scores) / floor
        after = sum(s.after * s.floor_m2 for s in scores) / floor
        rows.append(
            (
                "true floor that is there, before and after",
                f"{100 * before:.2f} % → {100 * after:.2f} %",
                "",
            )
        )
        rows.append(
            (
                "height error in the scan's own gaps, median and 99th percentile",
                f"{np.median(natural):.2f} mm, {np.percentile(natural, 99):.1f} mm",
                "",
            )
        )
    rows.append(
        (
            "scan vertices moved, flattened bumps apart",
            f"{sum(s.moved for s in scores)} of {sum(s.vertices for s in scores):,}",
            "0",
        )
    )
    return [
        "| | measured | target |",
        "| --- | ---: | ---: |",
        *(f"| {name} | {value} | {target} |" for name, value, target in rows),
    ]


def by_kind(scores: Sequence[Score]) -> list[str]:
    """Return a table of kinds, and one of sizes."""
    everything = [h for s in scores for h in s.holes if not h.hole.decoy and h.area_m2 > 0]
    lines = _group_table(
        "kind", [(kind, [h for h in everything if h.hole.kind == kind]) for kind in KINDS]
    )
    torn = [h for h in everything if h.hole.ragged]
    lines += _rows([("torn rims, of all kinds", torn)])
    bands = pairwise(SIZES_M)
    lines += [
        "",
        *_group_table(
            "longest side",
            [
                (
                    f"{100 * a:.0f} … {100 * b:.0f} cm",
                    [h for h in everything if a <= h.hole.size_m < b],
                )
                for a, b in bands
            ],
        ),
    ]
    return lines


def missed(scores: Sequence[Score]) -> list[str]:
    """Return holes that stayed open and decoys that were filled, with the repair's reason."""
    rows = [
        f"| {s.scene} | {h.hole.name} | {_middle(h)} | {100 * h.hole.size_m:.0f} "
        f"| {1e4 * h.area_m2:.0f} "
        f"| {100 * h.share:.1f} | {h.reason} |"
        for s in scores
        for h in s.holes
        if h.area_m2 > 0 and h.filled == h.hole.decoy
    ]
    if not rows:
        return ["None."]
    return [
        "| scene | hole | at x, y | cm | cm² | % filled | what repair.json says |",
        "| --- | --- | ---: | ---: | ---: | ---: | --- |",
        *rows,
    ]


def _middle(score: HoleScore) -> str:
    lower, upper = score.hole.outline.bounds_m()
    x, y = (lower + upper) / 2
    return f"{x:.2f}, {y:.2f}"


def _group_table(title: str, groups: list[tuple[str, list[HoleScore]]]) -> list[str]:
    return [
        f"| {title} | holes | area, m² | area filled | holes filled | error, median | 99 % |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: |",
        *_rows(groups),
    ]


def _rows(groups: list[tuple[str, list[HoleScore]]]) -> list[str]:
    rows = []
    for name, holes in groups:
        if not holes:
            continue
        area, filled = sum(h.area_m2 for h in holes), sum(h.filled_m2 for h in holes)
        whole = sum(h.filled for h in holes) / len(holes)
        errors = 1000 * np.abs(np.concatenate([h.errors_m for h in holes]))
        middle, most = np.percentile(errors, [50, 99]) if len(errors) else (np.nan, np.nan)
        rows.append(
            f"| {name} | {len(holes)} | {area:.3f} | {100 * filled / area:.2f} % "
            f"| {100 * whole:.1f} % | {middle:.2f} mm | {most:.1f} mm |"
        )
    return rows
