"""What every kind of scan has to stand, shared by the test files of the formats."""

import os
import shutil
from pathlib import Path

from tests.security.hostile import put, refusal
from tests.support.scenes.damage import picture_bytes
from vlnpe.scene_repair.scan.dispatch import read_scan
from vlnpe.scene_repair.scan.record import Scan


def check_places(suffix: str, kind: str, folder: Path) -> None:
    """Something that is no file is called what it is."""
    path = folder / f"scan{suffix}"
    complaint = put(kind, path)
    assert complaint in refusal(lambda: read_scan(path)).reason


def check_names(data: bytes, suffix: str, folder: Path) -> None:
    """A name that is not UTF-8 ends in an error that can be printed; others are read."""
    good = folder / f"Wohnzimmer – 居間{suffix}"
    good.write_bytes(data)
    assert len(read_scan(good).faces)
    bad = Path(os.fsdecode(os.fsencode(folder) + b"/\xff\xfe" + suffix.encode()))
    bad.write_bytes(data)
    assert "not UTF-8" in refusal(lambda: read_scan(bad)).reason


def check_the_users_link(data: bytes, suffix: str, folder: Path) -> None:
    """A scan that is itself a link is the user's choice."""
    (folder / "elsewhere").mkdir()
    target = folder / "elsewhere" / f"scan{suffix}"
    target.write_bytes(data)
    (folder / f"link{suffix}").symlink_to(target)
    assert len(read_scan(folder / f"link{suffix}").faces)


SECRET_SIDE = 8


def secret_picture() -> bytes:
    """A picture that nothing may show."""
    return picture_bytes(SECRET_SIDE, SECRET_SIDE)


def shows_secret(scan: Scan) -> bool:
    """Whether a material has the secret picture; the library has a small one of its own."""
    images = [material.image for material in scan.materials]
    return any(image is not None and image.size == (SECRET_SIDE, SECRET_SIDE) for image in images)


def outside(folder: Path, name: str, data: bytes) -> Path:
    """A file beside the scan's folder, and the folder."""
    (folder / name).write_bytes(data)
    inside = folder / "scan"
    shutil.rmtree(inside, ignore_errors=True)
    inside.mkdir()
    return inside
