"""`vlnpe push`: publish a dataset on the Hugging Face hub; by default, show what that means."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ..publish import CARD, Hub, Release, demand_licence, plan_release, upload

MEBIBYTE = 1024 * 1024


@dataclass(frozen=True)
class Push:
    """Publish a LeRobot dataset on the Hugging Face hub, under a tag that never moves.

    Without --yes nothing is uploaded, and no network is used: it shows what would be.
    """

    dataset: tyro.conf.Positional[Path]
    """A dataset's folder, runs/<name>/lerobot/<dataset>."""
    repo: str
    """Where to: user/name."""
    tag: str | None = None
    """Name of the release; by default one made of the content's digest."""
    private: bool = False
    """Make a new repository private."""
    licence_ok: bool = False
    """Publish although a scene's licence forbids it, or is unknown: you have the permission."""
    yes: bool = False
    """Upload."""
    json: Annotated[bool, tyro.conf.arg(name="json")] = False
    """Print one JSON object with the release as the last line."""


def run_push(options: Push, hub: Hub | None = None) -> int:
    """Show a release, and upload it when `options.yes`; `hub` stands in for the real one.

    Raises:
        InputError: no dataset, a bad name, a licence that forbids it, or a tag that exists.
        HubError: the hub refused, or could not be reached.
    """
    release = plan_release(options.dataset, options.repo, options.tag, options.private)
    if not options.json:
        sys.stdout.write(_shown(release, options.licence_ok))
    if not options.licence_ok:
        demand_licence(release)
    done = upload(release, hub) if options.yes else None
    if options.json:
        value = asdict(release) | {"root": str(release.root), "url": release.url}
        value["commit"] = done.commit if done else None
        sys.stdout.write(json.dumps(value) + "\n")
    elif done:
        what = "uploaded" if done.new else "published already, nothing changed"
        sys.stdout.write(f"\n{what}: {release.url}\n")
    else:
        sys.stdout.write("\nnothing was uploaded; to do it, say --yes\n")
    return 0


def _shown(release: Release, licence_ok: bool) -> str:
    total = sum(release.files.values())
    card = (release.root / CARD).read_text().split("---")[1].strip()
    lines = [
        f"repository  datasets/{release.repo}" + (" (private, if new)" if release.private else ""),
        f"release     {release.tag}, which must not exist there yet",
        f"content     {release.content_sha256}",
        f"files       {len(release.files)}, {total / MEBIBYTE:.1f} MiB",
        *(f"  {size:>14,}  {name}" for name, size in release.files.items()),
        "card",
        *(f"  {line}" for line in card.splitlines()),
    ]
    if release.refusals:
        lines.append("licence     " + ("permitted by --licence-ok" if licence_ok else "refused"))
        lines += [f"  {reason}" for reason in release.refusals]
    else:
        lines.append("licence     all scenes' licences let the data be published")
    return "\n".join(lines) + "\n"
