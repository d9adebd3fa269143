"""Digests of source code, and what is kept of them between processes."""

import os
import subprocess
import sys
from pathlib import Path

DIGEST = """
import sys
from pathlib import Path
from vlnpe.formats.core import source
source.ROOT = Path(sys.argv[1])
source.code_digest("one")
"""


def digest_of_one_module(root: Path, *flags: str) -> list[Path]:
    """Hash a module in a process of its own; return the files that this left in `__pycache__`."""
    env = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    (root / "one.py").write_text("import json\n")
    subprocess.run([sys.executable, *flags, "-c", DIGEST, str(root)], env=env, check=True)
    return list(root.glob("__pycache__/*"))


def test_parsed_imports_are_cached_between_processes(tmp_path):
    assert [path.name.split("-")[0] for path in digest_of_one_module(tmp_path)] == ["sources"]


def test_nothing_is_cached_when_python_is_told_to_write_no_bytecode(tmp_path):
    assert digest_of_one_module(tmp_path, "-B") == []
