"""Digests of source code, and what is kept of them between processes."""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

DIGEST = """
import sys
from pathlib import Path
from vlnpe.formats.process import source
source.ROOT = Path(sys.argv[1])
source.code_digest("one")
"""

OWNERS = """
import sys
from pathlib import Path
from vlnpe.formats.process import source
source.ROOT, sys.prefix = Path(sys.argv[1]), sys.argv[2]
found = []
source.packages_distributions = lambda: found.append(1) or {"made": ["it"]}
source.libraries("one")
sys.exit(10 + len(found))
"""


def digest_of_one_module(root: Path, *flags: str) -> list[Path]:
    """Hash a module in a process of its own; return the files that this left in `__pycache__`."""
    (root / "one.py").write_text("import json\n")
    assert run(DIGEST, root, flags=flags) == 0
    return list(root.glob("__pycache__/*"))


def run(code: str, *arguments: object, flags: Sequence[str] = ()) -> int:
    """Run code in a process that may write bytecode; return its exit code."""
    env = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    return subprocess.run(
        [sys.executable, *flags, "-c", code, *map(str, arguments)], env=env
    ).returncode


def test_parsed_imports_are_cached_between_processes(tmp_path):
    assert [path.name.split("-")[0] for path in digest_of_one_module(tmp_path)] == ["sources"]


def test_nothing_is_cached_when_python_is_told_to_write_no_bytecode(tmp_path):
    assert digest_of_one_module(tmp_path, "-B") == []


def test_environments_of_one_checkout_keep_their_own_lists_of_packages(tmp_path):
    """Each finds out once what is installed, also where they take turns."""
    (tmp_path / "one.py").write_text("import json\n")
    turns = [run(OWNERS, tmp_path, prefix) for prefix in ("a", "b", "a", "b")]
    assert turns == [11, 11, 10, 10]
