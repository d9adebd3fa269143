"""The source code: nothing in it unpickles, evaluates text, or runs a shell."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = (
    "apartments",
    "benchmarks",
    "collectors",
    "datasets",
    "evaluation",
    "examples",
    "formats",
    "geometry",
    "instruction_gen",
    "learning",
    "package",
    "pipeline",
    "rendering",
    "scene_repair",
    "trajectory_sampler",
    "viewer",
    "wayfinding",
)
BUILTINS = {"eval", "exec", "compile", "__import__"}
MODULES = {"pickle", "cPickle", "_pickle", "dill", "cloudpickle", "joblib", "shelve", "marshal"}
CALLS = {
    "os.system",
    "os.popen",
    "subprocess.getoutput",
    "subprocess.getstatusoutput",
    "yaml.load",
    "yaml.load_all",
    "yaml.unsafe_load",
    "yaml.full_load",
    "asyncio.create_subprocess_shell",
    "pandas.read_pickle",
    "numpy.fromregex",
}
# (file, what is found) → why it is safe.
REVIEWED = {
    (
        "pipeline/execution/attempts.py",
        "import pickle",
    ): "a copy of an error of this process, to see whether a worker can send it",
    (
        "learning/models/encoders.py",
        "import pickle",
    ): "its UnpicklingError alone, which torch.load raises with weights_only",
    (
        "learning/training/train.py",
        "import pickle",
    ): "its UnpicklingError alone, which torch.load raises with weights_only",
}
# What numpy and torch are called by convention.
ALIASES = {"np": "numpy", "pd": "pandas", "th": "torch"}


def dotted(node: ast.expr) -> str:
    """Return `a.b.c` of an expression of names, with conventional aliases written out."""
    parts: list[str] = []
    while isinstance(node, ast.Attribute):
        parts.append(node.attr)
        node = node.value
    if not isinstance(node, ast.Name):
        return ""
    return ".".join([ALIASES.get(node.id, node.id), *reversed(parts)])


def is_constant(call: ast.Call, keyword: str, value: bool) -> bool:
    found = [k.value for k in call.keywords if k.arg == keyword]
    return len(found) == 1 and isinstance(found[0], ast.Constant) and found[0].value is value


def faults(tree: ast.AST) -> Iterator[str]:
    """Yield what a module does that it must not."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (f"import {a.name}" for a in node.names if a.name.split(".")[0] in MODULES)
        elif isinstance(node, ast.ImportFrom):
            module = (node.module or "").split(".")[0]
            if module in MODULES and not node.level:
                yield f"import {module}"
            # Under another name a call would not be recognized.
            for alias in node.names:
                if f"{node.module}.{alias.name}" in {*CALLS, "torch.load", "numpy.load"}:
                    yield f"from {node.module} import {alias.name}"
        elif isinstance(node, ast.Call):
            name = dotted(node.func)
            if name in BUILTINS or name in CALLS:
                yield f"{name}()"
            elif name == "torch.load" and not is_constant(node, "weights_only", True):
                yield "torch.load() without weights_only=True"
            elif name == "numpy.load" and not is_constant(node, "allow_pickle", False):
                yield "numpy.load() without allow_pickle=False"
            elif any(k.arg == "allow_pickle" for k in node.keywords) and not is_constant(
                node, "allow_pickle", False
            ):
                yield "allow_pickle"
            elif any(k.arg == "shell" for k in node.keywords) and not is_constant(
                node, "shell", False
            ):
                yield "shell=True"


def sources() -> list[Path]:
    return [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]


def test_nothing_unpickles_evaluates_or_uses_a_shell() -> None:
    found = {
        (path.relative_to(ROOT).as_posix(), fault)
        for path in sources()
        for fault in faults(ast.parse(path.read_bytes()))
    }
    assert found - set(REVIEWED) == set()
    assert set(REVIEWED) - found == set(), "no longer there; remove it from REVIEWED"


def test_all_packages_are_looked_at() -> None:
    inits = [*ROOT.glob("*/__init__.py"), *ROOT.glob("*/*/__init__.py")]
    packages = {path.relative_to(ROOT).parts[0] for path in inits}
    packages = {name for name in packages if not name.startswith(".")}
    assert packages - set(FOLDERS) <= {"tests", "build", "runs", "typings"}
    assert len(sources()) > 400


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("eval('1')", "eval()"),
        ("exec(x)", "exec()"),
        ("import pickle", "import pickle"),
        ("from pickle import loads", "import pickle"),
        ("import os; os.system('x')", "os.system()"),
        ("subprocess.run('x', shell=True)", "shell=True"),
        ("subprocess.run('x', shell=maybe)", "shell=True"),
        ("np.load(path)", "numpy.load() without allow_pickle=False"),
        ("np.load(path, allow_pickle=True)", "numpy.load() without allow_pickle=False"),
        ("np.save(path, x, allow_pickle=flag)", "allow_pickle"),
        ("torch.load(path)", "torch.load() without weights_only=True"),
        ("torch.load(path, weights_only=False)", "torch.load() without weights_only=True"),
        ("from torch import load", "from torch import load"),
        ("yaml.load(text, Loader=yaml.Loader)", "yaml.load()"),
    ],
)
def test_each_of_them_would_be_found(text: str, fault: str) -> None:
    assert fault in list(faults(ast.parse(text)))


@pytest.mark.parametrize(
    "text",
    [
        "re.compile(x)",
        "agent.eval()",
        "spec.compile()",
        "np.load(path, allow_pickle=False)",
        "torch.load(path, weights_only=True)",
        "subprocess.run(['x'])",
        "yaml.safe_load(text)",
    ],
)
def test_safe_code_passes(text: str) -> None:
    assert not list(faults(ast.parse(text)))
