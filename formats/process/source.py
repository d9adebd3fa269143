"""The source code behind a result: the modules that a module imports, and a digest of them all.

Keys of work items and caches of compiled kernels use it, so that both notice an edit of any
function they depend on and ignore edits of all others.
"""

from __future__ import annotations

import ast
import atexit
import contextlib
import hashlib
import json
import platform
import sys
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from pathlib import Path
from typing import Any

from ..core.atomic import write_bytes

ROOT = Path(__file__).resolve().parents[2]  # of the package: in a checkout the repository
NAME = __name__.split(".")[0]
# Files that a package reads beside its modules. A robot's policy is an input of its own: replays
# of one robot do not depend on another's gait.
DATA_SUFFIXES = {".xml", ".j2", ".txt", ".yaml", ".html", ".css", ".js"}


@cache
def source_digest(*modules: str, unused: frozenset[str] = frozenset()) -> str:
    """Return the SHA-256 hex digest of everything that importing `modules` uses.

    That is the code of `code_digest`, and the versions of Python and of the libraries that the
    modules import.

    Args:
        modules: dotted names, with or without the leading `vlnpe.`.
        unused: distributions that the modules import, but that had no part in the result.

    Raises:
        ModuleNotFoundError: there is no such module (it was renamed, and keys would go blind).
    """
    state = hashlib.sha256(platform.python_version().encode())
    state.update(code_digest(*modules).encode())
    for name, installed in sorted(libraries(*modules).items()):
        if name not in unused:
            state.update(f"{name}=={installed}\n".encode())
    return state.hexdigest()


@cache
def code_digest(*modules: str) -> str:
    """Return the SHA-256 hex of the source of all of our modules that importing `modules` executes.

    Comments and docstrings do not count; the data files of the modules' packages do.
    """
    state = hashlib.sha256()
    ours = imported_modules(*modules)
    for module in sorted(ours):
        state.update(f"{module} {_source(module).digest}\n".encode())
    for folder in sorted({_path(module).parent for module in ours}):
        for path in sorted(folder.iterdir()):
            if path.suffix in DATA_SUFFIXES:
                state.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return state.hexdigest()


@cache
def imported_modules(*modules: str) -> frozenset[str]:
    """Return the names of all of our modules that importing `modules` executes, they included.

    Imports inside functions count, those for type checkers alone do not. A module's packages are
    executed with it.
    """
    waiting = [module.removeprefix(f"{NAME}.") for module in modules]
    reached: set[str] = set()
    while waiting:
        module = waiting.pop()
        if module in reached:
            continue
        reached.add(module)
        parent = module.rpartition(".")[0]
        if parent and _file(parent) is not None:
            waiting.append(parent)
        waiting.extend(_source(module).ours - reached)
    return frozenset(reached)


def module_digest(module: str) -> str:
    """Return the SHA-256 hex of one module's own code, without comments and docstrings."""
    return _source(module).digest


def libraries(*modules: str) -> dict[str, str]:
    """Return name and version of each installed distribution that the modules import."""
    owners = _owners()
    packages = {p for module in imported_modules(*modules) for p in _source(module).others}
    names = {name for package in packages for name in owners.get(package, ()) if name != NAME}
    versions = {name: _version(name) for name in names}
    return {name: installed for name, installed in versions.items() if installed is not None}


@cache
def _version(distribution: str) -> str | None:
    try:
        return version(distribution)
    except PackageNotFoundError:  # a stale record of the environment
        return None


@cache
def _owners() -> dict[str, list[str]]:
    """Return the distributions that bring each top-level package.

    The search takes half a second; it is cached as long as the same distributions are installed.
    """
    folders = {path for folder in sys.path for path in Path(folder).glob("*-info")}
    # With its time, because one version can be installed again with other packages in it.
    installed = sorted([str(path), path.stat().st_mtime_ns] for path in folders)
    # Environments that share this checkout have other packages each.
    cached = _disk_cache().facts["owners"].setdefault(sys.prefix, {})
    if cached.get("installed") != installed:
        cached["installed"], cached["of"] = installed, dict(packages_distributions())
    return cached["of"]


@cache
def _file(module: str) -> Path | None:
    base = ROOT.joinpath(*module.split("."))
    for path in (base.with_suffix(".py"), base / "__init__.py"):
        if path.is_file():
            return path
    return None


def _path(module: str) -> Path:
    path = _file(module)
    if path is None:
        raise ModuleNotFoundError(f"no module {NAME}.{module} below {ROOT}", name=module)
    return path


@dataclass(frozen=True)
class _Source:
    """Imports of one module (ours, and top-level names of others), and its digest."""

    ours: frozenset[str]
    others: frozenset[str]
    digest: str


@cache
def _source(module: str) -> _Source:
    path = _path(module)
    raw = path.read_bytes()
    text = hashlib.sha256(raw).hexdigest()
    known = _disk_cache().facts["modules"]
    cached = known.get(module)
    if cached is None or cached["text"] != text:
        cached = {"text": text, **_parse(module, path, raw)}
        known[module] = cached
    # Other files decide, too, whether a name is a module.
    ours = frozenset(name for name in cached["names"] if _file(name) is not None)
    return _Source(ours, frozenset(cached["others"]), cached["digest"])


@dataclass
class _DiskCache:
    """Facts of modules by the text they had, and of what is installed; and their file's content."""

    facts: dict[str, Any]
    written: str


@cache
def _disk_cache() -> _DiskCache:
    """Return the facts, which take seconds to collect, in every process that uses a kernel."""
    try:
        written = _cache_path().read_text()
        kept = _DiskCache(json.loads(written), written)
    except (OSError, ValueError):  # there is none yet
        kept = _DiskCache({"modules": {}, "owners": {}}, "")
    atexit.register(write_cache)
    return kept


def _cache_path() -> Path:
    this = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:16]
    return ROOT / "__pycache__" / f"sources-{sys.implementation.cache_tag}-{this}.json"


def write_cache() -> None:
    """Write what this process has found out, for those that it starts; its end does so, too."""
    kept = _disk_cache()
    text = json.dumps(kept.facts)
    if text != kept.written and not sys.dont_write_bytecode:
        with contextlib.suppress(OSError):  # an installed package may be read-only
            _cache_path().parent.mkdir(exist_ok=True)
            write_bytes(_cache_path(), text.encode())
        kept.written = text


def _parse(module: str, path: Path, raw: bytes) -> dict[str, Any]:
    """Return the names that a module imports, ours and others, and its digest."""
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    tree = ast.parse(raw)
    names: set[str] = set()
    others: set[str] = set()
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import):
            others.update(alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            others.add((node.module or "").split(".")[0])
        elif isinstance(node, ast.ImportFrom):
            parts = package.split(".")
            base = ".".join(parts[: len(parts) - node.level + 1])
            base = ".".join(part for part in (base, node.module) if part)
            for alias in node.names:
                name = f"{base}.{alias.name}" if base else alias.name
                # A name is a module of its own, or it is defined in the module before it.
                names.update(m for m in (base, name) if m)
        elif isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            docstring = ast.get_docstring(node, clean=False)
            node.body = node.body[docstring is not None :]
        # Expressions hold no imports and no docstrings.
        for field in ("body", "orelse", "finalbody", "handlers", "cases"):
            children = getattr(node, field, ())
            if not (field == "body" and _for_types_alone(node)) and isinstance(children, list):
                waiting += children
    digest = hashlib.sha256(ast.dump(tree).encode()).hexdigest()
    others -= set(sys.stdlib_module_names)
    return {"names": sorted(names), "others": sorted(others), "digest": digest}


def _for_types_alone(node: ast.AST) -> bool:
    test = getattr(node, "test", None)
    return isinstance(node, ast.If) and isinstance(test, ast.Name) and test.id == "TYPE_CHECKING"
