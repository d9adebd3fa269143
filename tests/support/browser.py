"""What a page hides in a real browser: headless Chromium, if there is one."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

_MEASURE = (
    "<script>onload=()=>{{document.title=[document.documentElement,"
    "...document.querySelectorAll('{boxes}')].map(e=>e.scrollWidth-e.clientWidth).join()}}</script>"
)


def hidden_px(page: str, boxes: str, width_px: int, folder: Path) -> list[int]:
    """Return how much wider than itself the page is, then each of its `boxes` (a CSS selector).

    Skips the test if there is no Chromium.
    """
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("no Chromium installed")
    file = folder / "page.html"
    file.write_text(page + _MEASURE.format(boxes=boxes), encoding="utf-8")
    done = subprocess.run(
        [
            chromium,
            *("--headless", "--no-sandbox", "--disable-gpu", "--disable-sync"),
            *("--disable-background-networking", "--disable-component-update"),
            f"--user-data-dir={folder / 'profile'}",
            *(f"--window-size={width_px},900", "--virtual-time-budget=5000", "--dump-dom"),
            file.as_uri(),
        ],
        check=True,
        capture_output=True,
        text=True,
        timeout=300,
    )
    title = re.search("<title>([-0-9,]+)</title>", done.stdout)
    assert title is not None
    return [int(number) for number in title[1].split(",")]
