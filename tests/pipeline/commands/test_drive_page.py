"""The page of `vlnpe drive` in a real browser: keys, fingers, and what is lost with the page."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.pipeline.commands.test_drive import ROBOT, prepared
from tests.support.devtools import Page, chromium
from tests.support.driver import PATIENCE_S, start

__all__ = ["prepared"]

pytestmark = [pytest.mark.slow, pytest.mark.chain]


@pytest.fixture(scope="module")
def page(prepared: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with chromium(tmp_path_factory.mktemp("browser")) as page:
        process, url = start(
            prepared, *ROBOT, "--episodes", prepared, "--out", prepared.parent / "paged"
        )
        page.url = url  # type: ignore[attr-defined]
        yield page
        process.terminate()
        process.communicate()


def show(page: Page) -> None:
    page.open(page.url)  # type: ignore[attr-defined]
    in_state(page, "waits")


@pytest.fixture(autouse=True)
def _opened(page: Page) -> None:
    show(page)


def in_state(page: Page, name: str) -> None:
    page.wait(f"document.body?.dataset.state === '{name}'", PATIENCE_S)


def pose(page: Page) -> str:
    return page.evaluate("document.body.dataset.pose")


@pytest.mark.parametrize(("key", "code"), [("w", "KeyW"), ("ArrowLeft", "ArrowLeft")])
def test_the_robot_moves_while_a_key_is_held(page: Page, key: str, code: str) -> None:
    before = pose(page)
    page.key(key, code, up=False)
    in_state(page, "moving")
    page.wait(f"document.body.dataset.pose !== '{before}' && vlnpe.response.length")
    page.key(key, code, down=False)
    in_state(page, "waits")
    assert page.evaluate("document.body.dataset.command") == "0,0,0"
    rest = pose(page)
    page.wait("new Promise(done => setTimeout(() => done(true), 500))")
    assert pose(page) == rest != before


def test_a_page_that_goes_away_stops_the_robot(page: Page) -> None:
    page.key("w", "KeyW", up=False)
    in_state(page, "moving")
    page.open("about:blank")
    page.key("w", "KeyW", down=False)
    show(page)
    assert page.evaluate("document.body.dataset.command") == "0,0,0"


def test_buttons_and_keys_stop_take_back_and_keep(page: Page) -> None:
    x, y = page.evaluate(
        "(b => [b.x + b.width / 2, b.y + b.height / 2])"
        "(document.querySelector('[data-hold=ahead]').getBoundingClientRect())"
    )
    at = {"x": x, "y": y, "button": "left", "clickCount": 1}
    page.call("Input.dispatchMouseEvent", type="mousePressed", **at)
    in_state(page, "moving")
    page.call("Input.dispatchMouseEvent", type="mouseReleased", **at)
    in_state(page, "waits")
    page.key("Enter", "Enter")
    in_state(page, "ended")
    assert "take it back" in page.evaluate("document.querySelector('#message').textContent")
    page.key("z", "KeyZ")
    in_state(page, "waits")
    page.click_on("Start over R")
    page.wait("document.body?.dataset.time === '0'")
    page.key("Enter", "Enter")
    in_state(page, "ended")
    first = page.evaluate("document.body.dataset.title")
    page.click_on("Keep K")
    page.wait(
        f"document.body.dataset.title !== '{first}' && document.body?.dataset.state === 'waits'"
    )


@pytest.mark.parametrize("width", [1180, 390])
def test_nothing_overlaps(page: Page, width: int) -> None:
    page.resize(width, 800)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.evaluate(
        "[...document.querySelectorAll('button, dd, h1, #instruction')].every(a => "
        "a.scrollWidth <= a.clientWidth + 1 || getComputedStyle(a).display === 'inline')"
    )
    boxes = page.evaluate(
        "[...document.querySelectorAll('button, figure, dl, header')].map(e => "
        "(b => [b.x, b.y, b.right, b.bottom])(e.getBoundingClientRect()))"
    )
    for k, (x0, y0, x1, y1) in enumerate(boxes):
        for a0, b0, a1, b1 in boxes[:k]:
            assert x0 >= a1 or a0 >= x1 or y0 >= b1 or b0 >= y1
    page.resize(1180, 800)
