"""Limits of what an untrusted file may cost to read, for all readers in one place.

No honest file comes near them. `VLNPE_LIMITS="vlnce_episodes=1000000 labels=50000"` in the
environment raises (or lowers) some; docs/design/security.md lists them all.
"""

import os
from dataclasses import dataclass, fields, replace

from ..core.errors import InputError, check_name

VARIABLE = "VLNPE_LIMITS"


@dataclass(frozen=True)
class Limits:
    """Caps of all readers.

    Attributes:
        scan_bytes: a mesh, point cloud or USD file, and each file that it refers to.
        splat_bytes: Gaussian splats in memory, with their harmonics.
        json_bytes: a JSON document, except for VLN-CE episodes; also the JSON part of a glTF file.
        json_values: keys, numbers, texts, lists and objects of a JSON document, roughly.
        text_bytes: a YAML or TOML document.
        depth: nesting of lists and objects in any document.
        yaml_nodes: values of a YAML document after its aliases are expanded.
        vlnce_bytes: an episode file, decompressed.
        vlnce_values: as `json_values`, of an episode file.
        vlnce_episodes: episodes of a file.
        labels: labelled boxes beside a scan.
        mcap_bytes: an MCAP file, and all its chunks together, decompressed.
        array_bytes: a file of arrays (.npz) or an archive of weights, decompressed.
        table_bytes: a Parquet table in memory.
        robot_files: files in a robot's folder.
        robot_file_bytes: each of them.
    """

    scan_bytes: int = 4 << 30
    splat_bytes: int = 2 << 30
    json_bytes: int = 256 << 20
    json_values: int = 20_000_000
    text_bytes: int = 1 << 20
    depth: int = 64
    yaml_nodes: int = 100_000
    vlnce_bytes: int = 2 << 30
    vlnce_values: int = 100_000_000
    vlnce_episodes: int = 250_000
    labels: int = 10_000
    mcap_bytes: int = 4 << 30
    array_bytes: int = 4 << 30
    table_bytes: int = 2 << 30
    robot_files: int = 10_000
    robot_file_bytes: int = 256 << 20


DEFAULTS = Limits()


def limits() -> Limits:
    """Return the defaults, with what the environment changes.

    Raises:
        InputError: the variable names an unknown limit, or a value is not a whole number above 0.
    """
    names = [f.name for f in fields(Limits)]
    changes: dict[str, int] = {}
    for entry in os.environ.get(VARIABLE, "").replace(",", " ").split():
        name, _, value = entry.partition("=")
        check_name(f"limit in {VARIABLE}", name, names)
        if not value.isdecimal() or int(value) < 1:
            raise InputError(f"{VARIABLE}: {name}={value}; valid: a whole number above 0")
        changes[name] = int(value)
    return replace(DEFAULTS, **changes) if changes else DEFAULTS
