"""Licences of what is installed, and the look-up of known vulnerabilities."""

import json
import threading
from collections.abc import Iterator
from email.message import Message
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.metadata import Distribution, distributions
from pathlib import Path
from typing import Any, cast

import pytest

from tests.support import audit

ROOT = Path(__file__).resolve().parents[2]


def test_everything_installed_is_permissive_or_reviewed() -> None:
    assert audit.licence_faults() == []


def test_reviewed_packages_are_installed_and_documented() -> None:
    names = {d.metadata["Name"].lower().replace("_", "-") for d in distributions()}
    page = (ROOT / "docs/design/libraries.md").read_text()
    for key in audit.REVIEWED:
        plain = key.removesuffix("*")
        if plain in ("cuda-toolkit", "nvidia-"):
            assert "CUDA" in page
            continue
        assert plain in names, f"{key} is no longer installed; remove it"
    assert "x264 and x265" in page and "FFmpeg" in page
    assert "x264 and x265" in (ROOT / "README.md").read_text()


class Package:
    """As much of a distribution as the gate looks at."""

    version = "1"

    def __init__(self, name: str, files: tuple[str, ...] = (), **metadata: str) -> None:
        self.metadata = Message()
        self.metadata["Name"] = name
        for key, value in metadata.items():
            self.metadata[key.replace("_", "-")] = value
        self.files = [Path(file) for file in files]


@pytest.mark.parametrize(
    ("package", "reason"),
    [
        (Package("a", License_Expression="GPL-3.0-or-later"), "GPL"),
        (Package("a", License_Expression="AGPL-3.0-only"), "AGPL"),
        (Package("a", License_Expression="MIT AND GPL-2.0-only"), "GPL"),
        (Package("a", License="GNU Affero General Public License v3"), "GNU"),
        (Package("a", License="LGPL-2.1"), "LGPL"),
        (
            Package(
                "a", Classifier="License :: OSI Approved :: GNU General Public License v3 (GPLv3)"
            ),
            "GNU",
        ),
        (Package("a"), "names no licence"),
        (Package("a", License="UNKNOWN"), "names no licence"),
        (Package("a", License="LicenseRef-Proprietary"), "unknown licence"),
        (Package("a", License="MIT", files=("a.libs/libx264-1b.so.165",)), "bundles libx264"),
    ],
)
def test_licences_that_need_a_decision_are_named(package: Package, reason: str) -> None:
    (fault,) = audit.licence_faults([cast(Distribution, package)])
    assert fault.package == "a 1"
    assert reason in fault.reason


@pytest.mark.parametrize(
    "package",
    [
        Package("a", License_Expression="MIT OR GPL-2.0-only"),
        Package("a", License_Expression="Apache-2.0"),
        Package("a", License="3-Clause BSD License"),
        Package("a", Classifier="License :: OSI Approved :: ISC License (ISCL)"),
        Package("nvidia_anything", License="Proprietary"),
    ],
)
def test_permissive_licences_pass(package: Package) -> None:
    assert audit.licence_faults([cast(Distribution, package)]) == []


@pytest.fixture
def osv() -> Iterator[tuple[str, dict[str, Any]]]:
    """A server that answers as OSV does; `known` names the package that has a vulnerability."""
    known: dict[str, Any] = {"name": ""}
    entry = {
        "id": "GHSA-0000-0000-0000",
        "modified": "2026-01-01T00:00:00Z",
        "published": "2026-01-01T00:00:00Z",
        "summary": "a made-up fault",
        "affected": [],
    }

    class Handler(BaseHTTPRequestHandler):
        def _send(self, value: Any) -> None:
            data = json.dumps(value).encode()
            self.send_response(200)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def do_POST(self) -> None:
            asked = json.loads(self.rfile.read(int(self.headers["Content-Length"])))["queries"]
            short = {key: entry[key] for key in ("id", "modified")}
            self._send(
                {
                    "results": [
                        {"vulns": [short]} if q["package"]["name"] == known["name"] else {}
                        for q in asked
                    ]
                }
            )

        def do_GET(self) -> None:
            self._send(entry)

        def log_message(self, format: str, *args: Any) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/", known
        server.shutdown()


def audited(address: str) -> tuple[bool, str]:
    found, text = audit.vulnerabilities(options=("--service-url", address), seconds=60)
    if "not looked up" in text and "unrecognized" in text:
        pytest.skip("this uv has no audit")
    return found, text


@pytest.mark.chain
def test_a_known_vulnerability_is_found(osv: tuple[str, dict[str, Any]]) -> None:
    address, known = osv
    assert audited(address)[0] is False
    known["name"] = "pillow"
    found, text = audited(address)
    assert found, text
    assert "pillow" in text and "GHSA-0000-0000-0000" in text


def test_without_a_network_it_reports_that_and_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UV_HTTP_RETRIES", "0")
    found, text = audited("http://127.0.0.1:9/")
    assert not found
    assert "not looked up (offline?)" in text


def test_without_uv_it_reports_that(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(audit, "ROOT", tmp_path)
    monkeypatch.setenv("PATH", "")
    assert audit.vulnerabilities() == (False, "vulnerabilities: not looked up, there is no uv")
