"""A page in headless Chromium, driven over its DevTools protocol."""

import base64
import contextlib
import itertools
import json
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

import pytest

# Software rendering: no GPU is needed.
_FLAGS = (
    *("--headless=new", "--no-sandbox", "--hide-scrollbars", "--mute-audio", "--no-first-run"),
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"),
    *("--disable-sync", "--disable-background-networking", "--disable-component-update"),
    *("--disable-background-timer-throttling", "--disable-renderer-backgrounding"),
    "--remote-debugging-port=0",
)


class Page:
    """A tab."""

    def __init__(self, connection: Any):
        self._connection = connection
        self._ids = itertools.count(1)
        self.requests: list[str] = []

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        wanted = next(self._ids)
        self._connection.send(json.dumps({"id": wanted, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._connection.recv(timeout=120))
            if answer.get("method") == "Network.requestWillBeSent":
                self.requests.append(answer["params"]["request"]["url"])
            if answer.get("id") == wanted:
                assert "error" not in answer, answer["error"]
                return answer["result"]

    def open(self, url: str) -> None:
        self.call("Page.navigate", url=url)

    def resize(self, width_px: int, height_px: int) -> None:
        size = {"width": width_px, "height": height_px, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **size)

    def evaluate(self, expression: str) -> Any:
        """Return the JSON value of a JavaScript expression, awaited if it is a promise."""
        options = {"returnByValue": True, "awaitPromise": True}
        result = self.call("Runtime.evaluate", expression=expression, **options)
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def wait(self, expression: str, seconds: float = 120) -> Any:
        """Return the value of an expression as soon as it is true."""
        return until(lambda: self.evaluate(expression), seconds, expression)

    def text(self) -> str:
        return self.evaluate("document.body ? document.body.innerText : ''")

    def wait_for(self, text: str, seconds: float = 120) -> None:
        """Wait until the page shows a text."""
        until(lambda: text in self.text(), seconds, f"{text!r} on the page")

    def key(self, key: str, code: str, *, up: bool = True, down: bool = True) -> None:
        """Press a key, or only its one half."""
        number = ord(key.upper()) if len(key) == 1 else 0
        for kind, chosen in (("keyDown", down), ("keyUp", up)):
            if chosen:
                names = {"key": key, "code": code, "windowsVirtualKeyCode": number}
                self.call("Input.dispatchKeyEvent", type=kind, **names)

    def click(self, x: float, y: float) -> None:
        for kind in ("mousePressed", "mouseReleased"):
            at = {"x": x, "y": y, "button": "left", "clickCount": 1}
            self.call("Input.dispatchMouseEvent", type=kind, **at)

    def click_on(self, text: str) -> None:
        """Click on the innermost visible element with this text."""
        found = self.wait(
            "(() => { let last; for (const e of document.querySelectorAll('body *'))"
            f" if ((e.innerText || '').trim() === {text!r} && e.getBoundingClientRect().width)"
            " last = e; if (!last) return; last.scrollIntoView({block: 'center'});"
            " const b = last.getBoundingClientRect();"
            " return [b.x + b.width / 2, b.y + b.height / 2] })()"
        )
        self.click(*found)

    def screenshot(self, path: Path | None = None) -> bytes:
        """Return the page as PNG, and write it to `path`."""
        data = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        if path is not None:
            path.write_bytes(data)
        return data


def until(condition: Callable[[], Any], seconds: float, what: str) -> Any:
    """Return the first true value of a condition."""
    end = time.monotonic() + seconds
    while not (value := condition()):
        assert time.monotonic() < end, f"not within {seconds} s: {what}"
        time.sleep(0.1)
    return value


@contextlib.contextmanager
def chromium(folder: Path, width_px: int = 1180, height_px: int = 800) -> Iterator[Page]:
    """Start Chromium with a profile in `folder`; skip the test if there is none."""
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        pytest.skip("no Chromium installed")
    from websockets.sync.client import connect

    profile = folder / "profile"
    process = subprocess.Popen(
        [program, *_FLAGS, f"--user-data-dir={profile}", "about:blank"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        port_file = profile / "DevToolsActivePort"
        until(lambda: port_file.is_file() and port_file.read_text().count("\n"), 60, "Chromium")
        port = port_file.read_text().split()[0]
        new = Request(f"http://127.0.0.1:{port}/json/new?about:blank", method="PUT")
        address = json.loads(urlopen(new, timeout=30).read())["webSocketDebuggerUrl"]
        with connect(address, max_size=None, proxy=None, ping_interval=None) as connection:
            page = Page(connection)
            page.call("Page.enable")
            page.call("Network.enable")
            page.resize(width_px, height_px)
            yield page
    finally:
        process.terminate()
        process.wait(timeout=30)
