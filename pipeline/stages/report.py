"""Stages `pictures` and `report`: maps and film strips, then the page that shows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ...formats.atomic import atomic_file, write_json
from ...formats.mcap.rollout import read_rollout
from ...formats.scene_bundle import load_bundle
from ..keys import code_version, digest
from ..ledger import Ledger, Row
from ..report.build import build_page
from ..report.gather import replay_rows
from ..run_folder import RunFolder
from ..runner import Context, ItemResult, StageSummary, WorkItem, run_stage

PICTURES_STAGE = "pictures"
STAGE = "report"
PAGE = "index.html"


def write(folder: RunFolder, context: Context, summaries: list[StageSummary]) -> Path:
    """Bring the report up to date with the ledger; returns the page."""
    ledger = context.ledger
    rows = replay_rows(ledger)
    maps = _map_items(folder, ledger)
    strips = _strip_items(folder, ledger, rows)
    items = [*maps.values(), *strips.values()]
    pictures = run_stage(context, PICTURES_STAGE, items)
    page = folder.report / PAGE
    good = pictures.good()
    arguments = (
        folder.root,
        {name: item.outputs[0] for name, item in maps.items() if item.name in good},
        {name: item.outputs[0] for name, item in strips.items() if item.name in good},
        page,
    )
    shown = [row for row in ledger.rows() if row.stage != STAGE]
    # The page shows outcomes, not only what was done: a mended item keeps its key.
    content = [replace(row, seconds=0.0) for row in shown]
    code = code_version("pipeline/report", "pipeline/stages/report.py", "formats")
    key = digest(STAGE, content, code)
    summaries.append(pictures)
    item = WorkItem(PAGE, key, (page,), process_page, arguments)
    summaries.append(run_stage(context, STAGE, [item]))
    return page


def process_page(
    root: Path, maps: dict[str, Path], strips: dict[str, Path], out: Path
) -> ItemResult:
    """Write the page."""
    text = build_page(root, maps, strips)
    with atomic_file(out) as temporary:
        temporary.write_text(text)
    return ItemResult({"bytes": len(text)})


def _map_items(folder: RunFolder, ledger: Ledger) -> dict[str, WorkItem]:
    result = {}
    for row in ledger.rows("repair"):
        if row.status != "done":
            continue
        for level in range(int(row.facts["levels"])):
            name = f"{row.item}/{level}"
            out = folder.report / "maps" / f"{row.item}-{level}.png"
            key = digest("map", row.key, level, code_version("collectors", "formats"))
            arguments = (folder.scenes / row.item, level, out)
            outputs = (out, out.with_suffix(".json"))
            result[name] = WorkItem(f"map {name}", key, outputs, process_map, arguments)
    return result


def process_map(scene: Path, level: int, out: Path) -> ItemResult:
    """Render one level from above."""
    from ...collectors.rendering.pictures import save_picture
    from ...collectors.rendering.registry import make_renderer
    from ...collectors.rendering.scene_map import top_down_map

    bundle = load_bundle(scene)
    picture = top_down_map(bundle, make_renderer(bundle), level)
    height, width = picture.image.shape[:2]
    mapping = {
        "left_m": picture.left_m,
        "top_m": picture.top_m,
        "px_per_m": picture.px_per_m,
        "width": width,
        "height": height,
    }
    write_json(out.with_suffix(".json"), mapping)
    save_picture(out, picture.image)
    return ItemResult()


def _strip_items(folder: RunFolder, ledger: Ledger, rows: Sequence[Row]) -> dict[str, WorkItem]:
    """One strip per robot and controller: of its first good episode, else of its first."""
    chosen: dict[str, Row] = {}
    for row in sorted(rows, key=lambda r: r.failed):
        chosen.setdefault(row.item.rsplit("/", 1)[0], row)
    code = code_version("collectors", "formats")
    result = {}
    for name, row in chosen.items():
        scene = ledger.row("repair", str(row.facts["scene"]))
        key = digest("strip", row.key, scene.key if scene else "", code)
        out = folder.report / "strips" / f"{name.replace('/', '-')}.jpg"
        arguments = (folder.scenes / str(row.facts["scene"]), folder.root / row.outputs[0], out)
        result[name] = WorkItem(f"strip {name}", key, (out,), process_strip, arguments)
    return result


def process_strip(scene: Path, rollout: Path, out: Path) -> ItemResult:
    """Render one episode as a strip of pictures."""
    from ...collectors.rendering.pictures import film_strip
    from ...collectors.rendering.registry import make_renderer

    film_strip(out, make_renderer(load_bundle(scene)), read_rollout(rollout))
    return ItemResult()
