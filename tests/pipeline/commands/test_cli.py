"""The command line: a table of commands that is true, and help that imports nothing heavy."""

import inspect
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import tyro

from vlnpe.collectors.controllers import SpeedConfig
from vlnpe.evaluation.policies.names import MODEL_POLICIES, ORACLE
from vlnpe.evaluation.policies.registry import POLICIES, shipped_policies
from vlnpe.formats.internnav.foreign import Assumptions
from vlnpe.instruction_gen.records import MIXED, InstructConfig
from vlnpe.pipeline.cli import VERBS, main
from vlnpe.pipeline.engine.ledger import MANIFEST_NAME
from vlnpe.pipeline.inputs.builtin import BUILTIN
from vlnpe.pipeline.inputs.crews import AUTO
from vlnpe.pipeline.options.collect import Collect
from vlnpe.pipeline.options.command_line import option_names
from vlnpe.pipeline.options.convert import Convert
from vlnpe.pipeline.options.evaluate import Evaluate
from vlnpe.pipeline.options.instructions import Instruct
from vlnpe.pipeline.options.rollouts import Replay

# Each of these takes a tenth of a second or more to import.
HEAVY = {
    "av", "cv2", "embreex", "huggingface_hub", "jinja2", "lerobot", "matplotlib", "mcap", "mujoco",
    "numba", "numpy", "onnxruntime", "open3d", "openai", "PIL", "pxr", "pyarrow", "pydantic",
    "scipy", "skimage", "torch", "trimesh",
}  # fmt: skip
SHOW_MODULES = """
import sys
from vlnpe.pipeline.cli import main
try:
    main(sys.argv[1:])
finally:
    print(*sorted(sys.modules))
"""


SHOW_HELP = """
import contextlib, io, json, sys
from vlnpe.pipeline.cli import main

shown = {}
for verb in sys.argv[1:]:
    with contextlib.redirect_stdout(io.StringIO()) as text:
        try:
            main([*verb.split(), "--help"])
        except SystemExit as end:
            shown[verb] = end.code, text.getvalue(), sorted(sys.modules)
print(json.dumps(shown))
"""


@pytest.fixture(scope="module")
def helps() -> dict[str, tuple[int, str, list[str]]]:
    """Exit code and text of every command's help, and the modules that are imported by then."""
    command = [sys.executable, "-c", SHOW_HELP, "", *VERBS]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


@pytest.mark.parametrize("name", VERBS)
def test_table_agrees_with_the_commands(name: str) -> None:
    verb = VERBS[name]
    first = inspect.cleandoc(verb.options().__doc__ or "").split("\n\n")[0]
    assert verb.summary() == " ".join(first.split())
    first_parameter, *_ = inspect.signature(verb.run(), eval_str=True).parameters.values()
    assert first_parameter.annotation is verb.options()


@pytest.mark.chain
@pytest.mark.parametrize("name", ["", *VERBS])
def test_help_imports_nothing_heavy(name: str, helps) -> None:
    code, text, loaded = helps[name]
    assert code == 0 and f"usage: vlnpe {name}".strip() in text
    assert {module.split(".")[0] for module in loaded} & HEAVY == set()
    assert [m for m in loaded if m.startswith("vlnpe.pipeline.commands")] == []


def test_help_of_evaluate_names_every_policy(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "1000")  # a name would be divided between two lines
    with pytest.raises(SystemExit):
        main(["evaluate", "--help"])
    text = capsys.readouterr().out
    for option, names in (
        ("--policy", [*POLICIES, *MODEL_POLICIES, ORACLE, *shipped_policies()]),
        ("--max-tokens", MODEL_POLICIES),
    ):
        said = re.split(rf"{option} (?:STR|INT) ", text)[1].split("(default")[0]
        assert [n for n in names if not re.search(rf"(?<![\w-]){n}(?![\w-])", said)] == [], option


def test_help_has_a_command_s_own_options_first_each_in_one_paragraph(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "1000")
    with pytest.raises(SystemExit):
        main(["collect", "--help"])
    lines = [line.strip("│| ") for line in capsys.readouterr().out.splitlines()]
    options = [line.split()[0] for line in lines if re.match("--?[a-z]", line)]
    assert options[:4] == ["-h,", "--robot", "--scene", "--scenes"]
    assert options[-1].startswith("--json") and len(options) == len(set(options))
    assert any(line.startswith("--robot ") and "widest one. (default:" in line for line in lines)
    assert any(line.startswith("--scenes PATH ") for line in lines)
    assert not any("None" in line for line in lines)


def test_help_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    text = capsys.readouterr().out.splitlines()
    listed = [line.split()[0] for line in text if line.startswith("    ") and line[4] != " "]
    assert [name for name in listed if name in VERBS] == list(VERBS)


@pytest.mark.chain
def test_a_command_imports_no_other_command() -> None:
    modules = subprocess.run(
        [sys.executable, "-c", SHOW_MODULES, "doctor", "--json"], capture_output=True, text=True
    ).stdout.splitlines()[-1]
    loaded = [m for m in modules.split() if m.startswith("vlnpe.pipeline.commands.")]
    assert loaded == ["vlnpe.pipeline.commands.look"]


def test_defaults_are_those_of_the_configurations() -> None:
    """Options repeat them, because the modules of the configurations import too much for help."""
    collect, instruct, convert = Collect(), Instruct(Path(), Path()), Convert(Path(), "mcap")
    replay, evaluate = Replay(Path(), Path()), Evaluate(Path())
    for options in (collect, replay):
        assert options.controller == AUTO
    for options in (collect, replay, evaluate):
        assert options.action_steps == SpeedConfig.steps_per_action
    for options in (collect, instruct):
        assert (options.writer, options.style) == (InstructConfig.writer, MIXED)
        assert options.count == InstructConfig.count
    assert collect.scene == BUILTIN
    for name in ("hfov_deg", "base_height_m", "frames_per_second", "split", "rgb_codec", "robot"):
        assert getattr(convert, name) == getattr(Assumptions, name)


def test_no_command_exits_with_code_2(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_:
        main([])
    assert exit_.value.code == 2
    assert "vlnpe" in "".join(capsys.readouterr())


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["collect", "--robot"], "--robot: no value follows; see "),
        (["convert", "data", "--to"], "--to: no value follows; see "),
        (["instruct", "run", "--show", "--json"], "--show: no value follows; see "),
        (["collect", "--seed=abc"], "--seed 'abc': not a whole number"),
        (["collect", "--max-turning-deg", "wide"], "--max-turning-deg 'wide': not a number"),
        (["collect", "--robot-radius-m", "nan"], "--robot-radius-m 'nan': not a number"),
        (["scan", "--exact", "--out", "x", "villa"], "SEED 'villa': not a whole number"),
    ],
)
def test_a_value_that_is_missing_or_no_number_is_named(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"vlnpe: error: {said}")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("review nowhere", "nowhere: no such file or folder"),
        ("view nowhere", "nowhere: no such file or folder"),
        ("instruct . --scenes nowhere", "nowhere: no such file or folder"),
        ("check-text . --texts nowhere.jsonl", "nowhere.jsonl: no such file or folder"),
        ("instruct . --out .", "--out .: is a folder; valid: a file"),
        ("view . --save .", "--save .: is a folder; valid: a file"),
        ("review . --port 65536", "--port 65536; valid: 0 to 65535"),
        ("view . --port -1", "--port -1; valid: 0 to 65535"),
        ("drive builtin --port 65536", "--port 65536; valid: 0 to 65535"),
        ("serve random --port 65536", "--port 65536; valid: 0 to 65535"),
    ],
)
def test_a_path_or_port_that_cannot_be_is_named_before_anything_is_done(
    words: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words.split()) == 2
    assert capsys.readouterr().err == f"vlnpe: error: {said}\n"
    assert list(tmp_path.iterdir()) == []


def test_a_misspelt_command_suggests_the_closest(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["colect", "--robot", "h1"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    said = "vlnpe: error: unknown command 'colect' (did you mean collect?); valid: ablate, adapt, "
    assert line.startswith(said)


@pytest.mark.parametrize("name", VERBS)
def test_an_unknown_option_is_answered_with_one_line(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also where arguments that the command needs are missing."""
    assert main([name, "--qux_zap", "1"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("vlnpe: error: unknown option '--qux_zap'; ")
    assert line.endswith(f"vlnpe {name} --help lists the valid ones")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["collect", "--robott", "h1"], "unknown option '--robott' (did you mean --robot?); "),
        (["convert", "data", "--too=mcap"], "unknown option '--too' (did you mean --to?); "),
        (["robots", "--no_jsn"], "unknown option '--no_jsn' (did you mean --no-json?); "),
        (["sample", "--radius", "1"], "'--radius' (did you mean --robot-radius-m?); "),
        (["collect", "--cam", "top", "h1"], "unknown option '--cam' (did you mean --camera?); "),
        (["collect", "h1"], "unknown argument 'h1'; "),
        (["doctor", "-x"], "unknown option '-x'; "),
        (["--foo"], "unknown option '--foo'; "),
    ],
)
def test_a_misspelt_option_suggests_the_closest(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert " --help lists the valid ones" in line


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["repair"], "repair: SCAN is missing"),
        (["align", "a.json.gz"], "align: --scenes is missing"),
        (["convert", "--to=mcap"], "convert: SOURCE is missing"),
        (["push"], "push: DATASET and --repo are missing"),
        (["restore", "data", "--json"], "restore: --original is missing"),
        (["train", "--seed", "1"], "train: RECIPE is missing"),
        (["compare", "first"], "compare: SECOND is missing"),
    ],
)
def test_a_missing_option_is_answered_with_one_line(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"vlnpe: error: {said}; see ")
    assert line.endswith(f"vlnpe {words[0]} --help")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["convert", "data", "--to", "rlds"], "unknown --to 'rlds'; valid: internvla-n1, lerobot"),
        (["convert", "data", "--to=mcp"], "unknown --to 'mcp' (did you mean mcap?); valid: "),
        (["convert", "d", "--to=n1", "--scan", "r2r_h1"], "unknown --scan 'r2r_h1'"),
    ],
)
def test_a_choice_that_there_is_not_lists_those_that_there_are(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"vlnpe: error: {said}")


@pytest.mark.filterwarnings("ignore:get_parser")
@pytest.mark.parametrize("name", VERBS)
def test_valid_options_are_those_of_the_parser(name: str) -> None:
    record = VERBS[name].options()
    parser = tyro.extras.get_parser(record, config=(tyro.conf.OmitArgPrefixes,))
    assert option_names(record) == set(parser._option_string_actions) - {"-h"}


@pytest.mark.parametrize("words", [["filter"], ["align", "--scenes", "scenes"]])
def test_commands_of_episode_files_need_one(
    words: list[str],
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    assert "error: no episode file; valid: one or more" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "words", [["scan"], ["collect", "--robot", "vlnce", "--seed"], ["evaluate", "run", "--seed"]]
)
def test_a_negative_seed_is_refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*words, "-5"]) == 2
    assert "seed -5: valid: 0 and above" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["verify", "report"])
def test_a_run_that_is_not_there_suggests_the_one_beside_it(
    command: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "apartment-aliengo").mkdir()
    (tmp_path / "apartment-aliengo" / MANIFEST_NAME).touch()
    (tmp_path / "apartment-aliengos").mkdir()  # no run
    assert main([command, str(tmp_path / "apartment-alieng")]) == 2
    error = capsys.readouterr().err
    assert "no such folder (did you mean apartment-aliengo?)" in error


@pytest.mark.chain
def test_mujoco_is_imported_without_glfw() -> None:
    """GLFW's import starts a process and takes a quarter of MuJoCo's time; EGL does without it."""
    code = "import sys; from vlnpe.pipeline.cli import main; main(['report', 'missing'])"
    code += "; import mujoco; print('glfw' in sys.modules)"
    environment = {k: v for k, v in os.environ.items() if k != "MUJOCO_GL"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout == "False\n"


@pytest.mark.chain
@pytest.mark.parametrize("words", [["--help"], ["collect", "--help"], ["robots", "--json"]])
def test_a_closed_pipe_ends_a_command_quietly(words: list[str]) -> None:
    """As in `vlnpe collect --help | head`, where head has read enough."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "vlnpe.pipeline.cli", *words]
    try:
        done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True)
    finally:
        os.close(writer)
    # Argparse, which writes the overview, takes no notice of a closed pipe.
    assert done.returncode in (0, 128 + signal.SIGPIPE)
    assert done.stderr == ""


def test_robots_says_what_a_gate_is_and_which_ones_are_missed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["robots", "--json"]) == 0
    robots = {robot["name"]: robot for robot in json.loads(capsys.readouterr().out)["robots"]}
    assert main(["robots"]) == 0
    table, _, told = capsys.readouterr().out.partition("\ngates: ")
    assert "docs/results/gaits.md" in told
    for name, robot in robots.items():
        missed = [gate["name"] for gate in robot["gates"] if not gate["passed"]]
        (line,) = [line for line in table.splitlines() if line.startswith(f"{name} ")]
        assert not missed or f"{len(robot['gates']) - len(missed)} of {len(robot['gates'])}" in line
        assert all(gate in told for gate in missed)
        assert bool(missed) == (f"\n  {name} " in told)
