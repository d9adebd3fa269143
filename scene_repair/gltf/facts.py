"""What a glTF file says about itself: licence, and the facts of a generated scene."""

from __future__ import annotations

from typing import Any

OWN_GENERATOR = "vlnpe"


def gltf_facts(tree: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Licence (empty if the file tells none) and generator facts, from a glTF file's JSON tree."""
    asset = tree.get("asset", {})
    extras = asset.get("extras", {})
    extras = extras if isinstance(extras, dict) else {}
    licence = str(extras.get("licence") or extras.get("license") or asset.get("copyright") or "")
    if asset.get("generator") != OWN_GENERATOR:
        return licence, {}
    return licence, {k: v for k, v in extras.items() if k not in ("licence", "license")}
