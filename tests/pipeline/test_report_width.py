"""The tables of both report pages fit the windows that people have, seen by a real browser."""

import re
import shlex
import subprocess
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jinja2 import Environment, PackageLoader

from tests.support.browser import hidden_px
from tests.support.devtools import chromium
from vlnpe.formats.core.checkout import CHECKOUT, program_in_checkout
from vlnpe.formats.trainers.answers import KINDS
from vlnpe.pipeline.engine.ledger import Row
from vlnpe.pipeline.report.gather import RobotRow
from vlnpe.pipeline.report.markdown_page import markdown_page
from vlnpe.pipeline.report.policy_page import policy_page

INSTRUCTION = "Turn left, walk past the washing machine on your right and stop near the table."


def evaluated(number: int) -> Row:
    rng = np.random.default_rng(number)
    rates = ("fall", "stuck", "oracle_success", "success", "spl", "ndtw")
    lengths = ("trajectory_length_m", "navigation_error_m", "duration_s")
    facts = {
        "metrics": {name: bool(rng.integers(2)) for name in rates}
        | {name: float(rng.uniform(80.0, 500.0)) for name in lengths},
        "end_reason": "stopped_far",
        "split": "val_unseen" if number % 2 else "val_seen",
        "scene": f"exact-apartment-20{number % 3}",
        "episode": f"episode-{number}",
        "trajectory": str(number),
        "instruction": INSTRUCTION,
        "contacts": number % 3,
        "detail": "",
        "taken": [1] * 500,
    }
    return Row("replay", f"aliengo/speed/episode-{number}", "", "done", facts=facts)


def evaluation_page() -> str:
    rows = [evaluated(number) for number in range(8)]
    setting = {
        "policy": "ws://127.0.0.1:8765",
        "policy_version": f"ws://127.0.0.1:8765 a-model-with-a-name {'0123456789abcdef' * 8}",
        "robot": "aliengo",
        "controller": "speed",
        "view": "ego-256x256-90deg-baked",
        "seed": 0,
        "episodes_sha256": "0" * 64,
    }
    lost = {"aliengo/speed/episode-9": f"FileNotFoundError: {'a-long-name' * 20}"}
    results = {"setting": setting, "episodes": [r.facts for r in rows], "quarantined": lost}
    return policy_page(results, rows, {})


def collection_page() -> str:
    # The longest cells of each kind.
    long: dict[Any, Any] = {int: 1234, float: 100.0, float | None: 100.0}
    values: dict[str, Any] = {f.name: long.get(f.type, "aliengo") for f in fields(RobotRow)}
    values["driven"] = "speed, open loop, 50 steps, seed 12"
    robots = [RobotRow(**values), RobotRow(**{**values, "robot": "my_own_robot"})]
    walk = {"robot": "aliengo", "controller": "speed", "outcome": "collision start"}
    walk |= dict.fromkeys(("tl", "off", "ne", "spl", "ndtw", "seconds"), 123.4)
    episode = {
        "anchor": "17@0",
        "id": "exact-apartment-200-17",
        "split": "val_unseen",
        "path": 12.3,
        "shortest": 123.4,
        "more_texts": [INSTRUCTION, INSTRUCTION],
    }
    episode |= {"instruction": INSTRUCTION, "walks": [walk]}
    lost = {"stage": "replay", "item": "aliengo/speed/exact-apartment-200-17"}
    counts = dict.fromkeys(KINDS, 123456)
    environment = Environment(
        loader=PackageLoader("vlnpe.pipeline.report", "."), trim_blocks=True, lstrip_blocks=True
    )
    return environment.get_template("page.html.j2").render(
        title="apartments",
        program=program_in_checkout(),
        folder="runs/apartments",
        robot_rows=robots,
        episodes=[episode],
        quarantine=[lost | {"reason": f"FileNotFoundError: {'a-long-name' * 20}"}],
        scenes=[],
        layouts={
            ("internvla-n1", "val_unseen/aliengo-path-ego-256x256-90deg-baked"): (counts, counts)
        },
        kinds=KINDS,
        colors={},
        splits=[],
    )


@pytest.mark.parametrize("width_px", [1180, 1400])
@pytest.mark.parametrize("page", [evaluation_page, collection_page])
def test_no_table_is_cut_off(page, width_px: int, tmp_path: Path) -> None:
    hidden = hidden_px(page(), ".scroll", width_px, tmp_path)
    assert len(hidden) >= 3  # the page, its tables
    assert max(hidden) <= 0, hidden


def test_tables_of_a_collection_fit_a_phone(tmp_path: Path) -> None:
    hidden = hidden_px(collection_page(), ".scroll", 390, tmp_path)
    assert len(hidden) >= 3
    assert max(hidden) <= 0, hidden


def test_commands_of_a_markdown_page_are_wrapped(tmp_path: Path) -> None:
    text = "```\nevaluate: vlnpe evaluate " + "/a/long/path" * 20 + "\n```"
    hidden = hidden_px(markdown_page("adapted", text), "pre", 1180, tmp_path)
    assert len(hidden) >= 2 and max(hidden) <= 0, hidden


def test_the_command_that_shows_the_robots_is_copied_with_a_click(tmp_path: Path) -> None:
    page_file = tmp_path / "my run's" / "report" / "index.html"
    page_file.parent.mkdir(parents=True)
    page_file.write_text(collection_page())
    with chromium(tmp_path) as page:
        page.open(page_file.as_uri())
        page.wait_for("Copy")
        page.click_on("Copy")
        page.wait("document.querySelector('#copied').textContent === ' copied'")
        words = shlex.split(page.evaluate("getSelection().toString()"))
    assert words == [program_in_checkout(), "view", str(tmp_path / "my run's")]
    # In a new shell, where no environment is active.
    shell = {"PATH": "/usr/bin:/bin"}
    said = subprocess.run([words[0], "--version"], env=shell, cwd=CHECKOUT, capture_output=True)
    assert said.stdout.startswith(b"vlnpe ")


def test_who_reads_of_people_has_some() -> None:
    assert "human" not in collection_page()


def test_no_word_of_a_head_is_divided() -> None:
    heads = re.findall("<th[^>]*>(.*?)</th>", collection_page())
    assert len(heads) > 20 and not [head for head in heads if "-<br>" in head]
