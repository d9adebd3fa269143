"""`vlnpe push`: publish a dataset or environment on the Hugging Face Hub; a dry run by default."""

import json
import sys
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory

from ..options.results import Push
from ..publish import CARD, Hub, Release, demand_licence, plan_release, upload
from ..publish_env import plan_env

MEBIBYTE = 1024 * 1024


def run_push(options: Push, hub: Hub = None) -> int:
    """Show a release, and upload it if `options.yes` is set; `hub` replaces the real Hub in tests.

    Raises:
        HubError: If the Hub refuses the upload or cannot be reached.
    """
    target = (options.repo, options.tag, options.private)
    if options.env is None:
        return _push(options, plan_release(options.dataset, *target), hub)
    with TemporaryDirectory(prefix="vlnpe-env-") as folder:
        return _push(options, plan_env(Path(folder), options.dataset, options.env, *target), hub)


def _push(options: Push, release: Release, hub: Hub) -> int:
    if not options.json:
        sys.stdout.write(_description(release, options.licence_ok))
    if not options.licence_ok:
        demand_licence(release)
    done = upload(release, hub) if options.yes else None
    if options.json:
        value = asdict(release) | {"root": str(release.root), "url": release.url}
        value["commit"] = done.commit if done else None
        sys.stdout.write(json.dumps(value) + "\n")
    elif done:
        what = "uploaded" if done.new else "already published, nothing changed"
        sys.stdout.write(f"\n{what}: {release.url}\n")
    else:
        sys.stdout.write("\nnothing was uploaded; pass --yes to upload\n")
    return 0


def _description(release: Release, licence_ok: bool) -> str:
    total = sum(release.files.values())
    card = (release.root / CARD).read_text().split("---")[1].strip()
    lines = [
        f"repository  {release.address}" + (" (private, if new)" if release.private else ""),
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
        lines.append("licence     publishing is permitted by the licences of all scenes")
    return "\n".join(lines) + "\n"
