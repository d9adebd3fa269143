"""The report of `vlnpe adapt`: what was gained on paths that were set aside, with films."""

import html
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ....evaluation.results import COLUMNS, cell_text, interval_of
from ....formats.core.atomic import write_bytes
from ....formats.core.checkout import program
from ...engine.ledger import Ledger
from ...report.markdown_page import markdown_page
from ...report.pictures import embedded_film
from ...report.policy_items import STAGE as FILMS
from ...report.policy_page import kind_of
from ...stages.evaluation.items import STAGE as WALKS

PAGE = "report.html"
_METRICS = ("SR", "OS", "SPL", "NE", "FR", "StR", "CR")
_MARK = "films of both walks"  # where the films stand in the page
_WIDE = 10.0  # half an interval of SR that is called a doubt [points]


def answer(value: Mapping[str, Any]) -> str:
    """Return the change of SR in a sentence."""
    before, after, change = (interval_of(value[k]["SR"]) for k in ("before", "after", "difference"))
    verdict = "no gain is shown"
    if change.low > 0:
        verdict = "a gain is shown"
    elif change.high < 0:
        verdict = "a loss is shown"
    return (
        f"SR of {value['policy']} on {value['held']} paths to rooms that it was not trained on: "
        f"{cell_text('SR', before)} % before, {cell_text('SR', after)} % after; difference "
        f"{cell_text('SR', change, sign='+')} points: {verdict}"
    )


def doubts(value: Mapping[str, Any]) -> list[str]:
    """Return what weakens the answer."""
    paths, result = value["train"] + value["held"], []
    if paths < value["asked"]:
        result.append(f"the building holds {paths} of {value['asked']} paths")
    change = interval_of(value["difference"]["SR"])
    if (half := (change.high - change.low) / 2) > _WIDE:
        result.append(
            f"changes of SR below about {half:.0f} points cannot be seen with {value['held']} paths"
        )
    if value["arrived"] < 0.8 * value["train"]:
        result.append(
            f"only {value['arrived']} of the expert's {value['train']} walks arrived; the others "
            "are not trained on"
        )
    if value["unknown"] > 0.05:
        result.append(
            f"{value['unknown']:.0%} of the words are not in the checkpoint's vocabulary and are "
            "read as unknown"
        )
    if value["failed"]:
        result.append(f"{value['failed']} walks have no result; see the evaluations")
    return result


def usage(value: Mapping[str, Any]) -> list[str]:
    """Return the commands that serve and test the checkpoint."""
    names = ("checkpoint", "held_file", "scenes", "robot")
    checkpoint, held, scenes, robot = (shlex.quote(value[name]) for name in names)
    return [
        f"serve:    {program()} serve {checkpoint} --port 5801",
        f"evaluate: {program()} evaluate {held} --scenes {scenes} --policy {checkpoint} "
        f"--robot {robot}",
    ]


def write_page(out: Path, value: Mapping[str, Any]) -> Path:
    """Write the report, which needs no other file, and return it."""
    title = f"{value['policy']} in {value['scene']}, {value['robot']}"
    page = markdown_page(html.escape(title), _markdown(title, value))
    write_bytes(out / PAGE, page.replace(f"<p>{_MARK}</p>", _films(out / "after")).encode())
    return out / PAGE


def _markdown(title: str, value: Mapping[str, Any]) -> str:
    lines = ["| | before | after | difference |", "| --- | ---: | ---: | ---: |"]
    for name in _METRICS:
        cells = [
            cell_text(name, interval_of(value[key][name]), sign=sign)
            for key, sign in (("before", ""), ("after", ""), ("difference", "+"))
        ]
        lines.append(f"| {name} [{COLUMNS[name][0]}] | {' | '.join(cells)} |")
    return "\n\n".join(
        [
            f"# {title}",
            f"**{answer(value)}.**",
            *(f"Doubt: {text}." for text in doubts(value)),
            "\n".join(lines),
            "Means with 95 % intervals over paths; differences are paired by path. They speak of "
            "other paths in this building, not of other buildings. SR: stopped within 3 m of the "
            "goal; OS: passed within 3 m; SPL: SR weighted by path length; NE: distance to the "
            "goal at the end; FR: fell; StR: got stuck; CR: touched an obstacle.",
            f"Set aside, {value['held']} paths: all whose goals lie in "
            f"{', '.join(value['held_rooms'])}. The expert walked the other {value['train']} "
            f"({value['controller']}), to {', '.join(value['rooms'])}; {value['arrived']} walks "
            f"arrived and were trained on for {value['steps']} steps. Paths to rooms set aside may "
            "lead through others.",
            "```\n" + "\n".join(usage(value)) + "\n```",
            "## Walks after the training",
            _MARK,
            "[All walks before](before/report.html) · [after](after/report.html)",
        ]
    )


def _films(evaluation: Path) -> str:
    """Return the films of an evaluation, one of each kind of ending, as HTML."""
    ledger = Ledger(evaluation)
    walks = {row.item: row.facts for row in ledger.done(WALKS)}
    figures = []
    for row in ledger.done(FILMS):
        film, facts = embedded_film(evaluation / row.outputs[0]), walks[row.item]
        text = html.escape(f"{kind_of(facts).replace('_', ' ')}: {facts['instruction']}")
        figures.append(
            f'<figure><video controls muted preload="none" style="max-width:100%" '
            f'poster="{film["poster"]}" src="{film["video"]}"></video>'
            f"<figcaption>{text}</figcaption></figure>"
        )
    return "\n".join(figures)
