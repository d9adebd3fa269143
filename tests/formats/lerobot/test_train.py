"""What README, docs and card say about loading and training, run as it stands."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.lerobot_data import write_units
from vlnpe.formats.lerobot import assemble_dataset

ROOT = Path(__file__).resolve().parents[3]
README, START = ROOT / "README.md", ROOT / "docs" / "start"
TRAINING = START / "train_and_evaluate.md"
# What does not matter to whether it works, but to how long it takes.
BRIEF = {
    "act": "dim_model=32 n_heads=2 dim_feedforward=32 n_encoder_layers=1 chunk_size=8 "
    "n_action_steps=8 device=cpu",
    "diffusion": "down_dims=[16,32,64] horizon=16 n_action_steps=8 device=cpu",
}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("train")
    root = folder / "set"
    units = write_units(folder, (6.0, 5.0))
    assemble_dataset(units, root, provenance={}, licence="mit", title="Rooms")
    return root


def run(words: list[str], folder: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    env = {k: v for k, v in os.environ.items() if not k.startswith("HF_")}
    env |= {"HF_HUB_OFFLINE": "1", "OMP_NUM_THREADS": "1", **variables}
    return subprocess.run(words, cwd=folder, env=env, capture_output=True, text=True)


def command_in(text: str) -> list[str]:
    """The only shell command of a Markdown text that trains."""
    (block,) = re.findall(r"```sh\n([^`]*lerobot-train [^`]*)```", text)
    return shlex.split(block.replace("\\\n", ""))


@pytest.mark.parametrize("policy", ["act", pytest.param("diffusion", marks=pytest.mark.slow)])
def test_the_documented_command_trains(dataset: Path, tmp_path: Path, policy: str) -> None:
    words = command_in(TRAINING.read_text())
    start = next(i for i, word in enumerate(words) if word.endswith("lerobot-train"))
    options = dict(word.split("=", 1) for word in words[start + 1 :])
    # The made-up images are smaller than the page's.
    features = options["--policy.input_features"].replace("[3, 256, 256]", "[3, 64, 96]")
    options |= {"--policy.type": policy, "--policy.input_features": features}
    options |= {"--dataset.root": str(dataset), "--output_dir": str(tmp_path / "out")}
    options |= {f"--policy.{k}": v for k, v in (o.split("=") for o in BRIEF[policy].split())}
    options |= {"--batch_size": "2", "--steps": "2", "--num_workers": "0", "--log_freq": "1"}
    trainer = str(Path(sys.executable).with_name("lerobot-train"))
    words = [trainer, *(f"{key}={value}" for key, value in options.items())]
    # No weights and no data of others.
    done = run(words, tmp_path, HF_HOME=str(tmp_path / "empty"))
    output = done.stdout + done.stderr
    assert done.returncode == 0, output[-3000:]
    assert "End of training" in output
    assert "nan" not in output.split("Start offline training")[-1].lower()
    assert list((tmp_path / "out").rglob("model.safetensors"))


def test_both_pages_say_the_same(dataset: Path) -> None:
    def policy(text: str) -> set[str]:
        return {word for word in command_in(text) if word.startswith("--policy.")}

    card = policy((dataset / "README.md").read_text().replace("[3, 64, 96]", "[3, 256, 256]"))
    assert card == policy(TRAINING.read_text())


def test_the_documented_code_loads(dataset: Path, tmp_path: Path) -> None:
    """LeRobot's own choice of decoder prints a long traceback where FFmpeg is not installed."""
    codes = []
    for page in (README, START / "first_dataset.md", dataset / "README.md"):
        (code,) = re.findall(r"```python\n([^`]*LeRobotDataset[^`]*)```", page.read_text())
        code = re.sub(r'"runs/[^"]*"', repr(str(dataset)), code)
        code = code.replace('"user/name",', f'"user/name", root={str(dataset)!r},')
        code += 'assert frame["observation.images.depth"].max() < 21, "metres"\n'
        codes.append(
            f"exec(compile({code!r}, {page.name!r}, 'exec'), {{'__name__': '__main__'}})\n"
        )
    done = run([sys.executable, "-c", "".join(codes)], tmp_path)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "Traceback" not in done.stderr and "torchcodec" not in done.stderr, done.stderr
