"""Training on a small set: what is learned, resumed, held out and refused."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch

from tests.support.training_data import WORDS, write_dataset
from vlnpe.datasets.mixture.recipe import recipe_of
from vlnpe.datasets.selection import select_all
from vlnpe.datasets.sequences import EpisodeSequences, SequenceConfig, collate_sequences
from vlnpe.datasets.tokens import training_tokens
from vlnpe.formats.core.errors import FileFormatError, InputError, UnknownNameError
from vlnpe.learning.camera import view_of
from vlnpe.learning.config import ModelConfig, TrainConfig, train_config
from vlnpe.learning.models.heads import FUTURE
from vlnpe.learning.models.registry import MODELS, Model
from vlnpe.learning.training.cache import CachedSequences
from vlnpe.learning.training.holdout import hold_out
from vlnpe.learning.training.plan import Request, plan_training, training_key
from vlnpe.learning.training.train import Watcher, learning_rate_factor, train_model

MODEL = {"channels": [4, 8], "hidden": 16, "words": 8}
TINY = {"steps": 6, "seeds": 2, "batch": 2, "size_px": 16, "model": MODEL, "device": "cpu"}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("runs")
    for robot in ("h1", "vlnce"):
        write_dataset(root / "run", robot, [1.5 + 0.25 * (n % 4) for n in range(8)])
    return root


@pytest.fixture(scope="module")
def episodes(runs: Path, tmp_path_factory: pytest.TempPathFactory) -> CachedSequences:
    selection = select_all([runs / "run" / "lerobot" / "vlnce"])
    how = SequenceConfig(size_px=16, future=FUTURE)
    sequences = EpisodeSequences(selection, training_tokens(WORDS, 12), how)
    return CachedSequences(sequences, tmp_path_factory.mktemp("cache"))


def recipe(**changes: Any) -> dict[str, Any]:
    value: dict[str, Any] = {
        "recipe": 1,
        "title": "Does the ghost help?",
        "sources": {"humanoid": {"robots": ["h1"]}, "ghost": {"robots": ["vlnce"]}},
        "mixtures": {"alone": ["humanoid"], "both": ["humanoid", "ghost"]},
        "train": TINY,
    }
    return value | changes


def test_an_interrupted_training_ends_as_if_it_had_not_been(
    episodes: CachedSequences, tmp_path: Path
) -> None:
    config = train_config({**TINY, "steps": 7, "checkpoint_every": 2})
    tokens = episodes.sequences.tokens

    def train(path: Path, stop: int | None = None) -> Model:
        def step(done: int, loss: float | None) -> None:
            if done == stop:
                raise KeyboardInterrupt

        sources, watcher = [episodes, episodes], Watcher(step)
        return train_model(sources, [0.7, 0.3], tokens, config, seed=1, state=path, watcher=watcher)

    before = torch.get_rng_state()
    whole = train(tmp_path / "whole.pt").state_dict()
    assert torch.equal(torch.get_rng_state(), before)
    with pytest.raises(KeyboardInterrupt):
        train(tmp_path / "part.pt", stop=5)
    resumed = train(tmp_path / "part.pt").state_dict()
    for name, value in whole.items():
        torch.testing.assert_close(resumed[name], value, atol=0, rtol=0, msg=name)


def test_a_damaged_decoded_episode_is_named_and_made_again(
    episodes: CachedSequences, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    cached = CachedSequences(episodes.sequences, tmp_path)
    # Items are views of their file, which is overwritten below: copy them.
    whole = {k: v.clone() for k, v in cached[0].items() if torch.is_tensor(v)}
    path = cached.prepare(0)
    content = path.read_bytes()
    generator = np.random.default_rng(0)
    flipped = [bytearray(content) for _ in range(8)]
    for damaged in flipped:
        damaged[generator.integers(len(content))] ^= 1 << int(generator.integers(8))
    for damaged in (content[:-100], content[:4], *flipped):
        path.write_bytes(damaged)
        caplog.clear()
        again = CachedSequences(episodes.sequences, tmp_path)[0]
        assert f"{path} is damaged" in caplog.text
        assert all(torch.equal(again[k], v) for k, v in whole.items())
        assert path.read_bytes() == content
    path.write_bytes(content[:-100])  # after it was checked
    with pytest.raises(FileFormatError, match=f"{path.name}.*delete it"):
        cached[0]


@pytest.mark.parametrize("name", ["cma", "seq2seq"])
def test_the_agent_knows_neither_the_future_nor_the_padding(
    name: str, episodes: CachedSequences
) -> None:
    torch.manual_seed(0)
    words = len(episodes.sequences.tokens.vocabulary.words)
    agent = MODELS[name](words, ModelConfig(channels=(4, 8), hidden=16)).eval()
    batch = collate_sequences([episodes[0], episodes[3]])
    steps = int(batch["length"][0])
    with torch.no_grad():
        both = agent(batch)
        alone = agent(collate_sequences([episodes[0]]))
        batch["rgb"][:, steps - 2 :] = 255 - batch["rgb"][:, steps - 2 :]
        other = agent(batch)
    for key, value in both.items():
        torch.testing.assert_close(value[0, :steps], alone[key][0], atol=1e-5, rtol=0)
        torch.testing.assert_close(value[:, : steps - 2], other[key][:, : steps - 2])
    assert not torch.equal(both["action"][0, steps - 2], other["action"][0, steps - 2])


@pytest.mark.parametrize("name", ["cma", "seq2seq"])
def test_short_instructions_are_read_as_if_alone(name: str, episodes: CachedSequences) -> None:
    torch.manual_seed(0)
    agent = MODELS[name](40, ModelConfig(channels=(4, 8), hidden=16)).eval()
    short, long = dict(episodes[0]), dict(episodes[3])
    for item, words in ((short, 3), (long, 77)):
        item["tokens"] = torch.zeros(80, dtype=torch.int64)
        item["tokens"][:words] = torch.randint(1, 40, (words,))
    with torch.no_grad():
        both = agent(collate_sequences([short, long]))
        alone = agent(collate_sequences([short]))
    steps = int(short["length"])
    for key, value in both.items():
        torch.testing.assert_close(value[0, :steps], alone[key][0], atol=1e-5, rtol=0)


@pytest.mark.parametrize("steps", range(1, 13))
def test_the_learning_rate_rises_and_falls_whatever_the_steps(steps: int) -> None:
    weight = torch.nn.Parameter(torch.zeros(1))
    optimizer = torch.optim.AdamW([weight], 1.0)
    schedule = torch.optim.lr_scheduler.LambdaLR(
        optimizer, lambda step: learning_rate_factor(step, steps)
    )
    rates = []
    for _ in range(steps):
        rates.append(schedule.get_last_lr()[0])
        optimizer.step()
        schedule.step()
    assert min(rates) > 0 and max(rates) == 1
    assert rates[rates.index(1.0) :] == sorted(rates[rates.index(1.0) :], reverse=True)


@pytest.mark.parametrize("steps", [1, 10])
def test_few_steps_are_enough_to_run(steps: int, episodes: CachedSequences, tmp_path: Path) -> None:
    config = train_config({**TINY, "steps": steps})
    done: list[int] = []
    watcher = Watcher(lambda step, loss: done.append(step))
    tokens, state = episodes.sequences.tokens, tmp_path / "a.pt"
    train_model([episodes], [1.0], tokens, config, seed=0, state=state, watcher=watcher)
    assert done == list(range(1, steps + 1))


def test_a_result_belongs_to_the_very_episodes_and_words(
    episodes: CachedSequences, runs: Path, tmp_path: Path
) -> None:
    shutil.copytree(runs / "run" / "lerobot", tmp_path / "lerobot")
    parsed = recipe_of(recipe())

    def result() -> str:
        return training_key(plan_training(Request(parsed, tmp_path, tmp_path, "alone")), 0)

    before = result()
    assert result() == before
    for file in (tmp_path / "lerobot" / "h1" / "meta" / "episodes").rglob("*.parquet"):
        table = pq.read_table(file)
        place = table.column_names.index("instructions")
        texts = [["Turn around."]] * table.num_rows
        pq.write_table(table.set_column(place, "instructions", [texts]), file)
    assert result() != before


@pytest.mark.parametrize(
    ("by", "scenes"), [("auto", 4), ("scene", 4), ("trajectory", 4), ("auto", 1)]
)
def test_no_trajectory_is_on_both_sides(by: str, scenes: int) -> None:
    trajectories = [f"mp3d/scene{n % scenes}/{n}" for n in range(20)]
    holdout = hold_out(recipe_of(recipe(holdout=by)), trajectories * 3)
    assert 0 < len(holdout.trajectories) < 20
    assert holdout.by == ("trajectory" if by == "trajectory" or scenes == 1 else "scene")
    if holdout.by == "scene":
        inside = {t.rsplit("/", 1)[0] for t in holdout.trajectories}
        outside = {t.rsplit("/", 1)[0] for t in set(trajectories) - holdout.trajectories}
        assert not inside & outside and inside == set(holdout.scenes)
    assert hold_out(recipe_of(recipe(holdout=by)), reversed(trajectories)) == holdout


def test_published_splits_are_what_is_held_out() -> None:
    trajectories = [f"scene{n % 4}/{n}" for n in range(20)]
    published = {"scene1/5", "scene3/7"}
    for by in ("auto", "split"):
        holdout = hold_out(recipe_of(recipe(holdout=by)), trajectories, published)
        assert (holdout.by, holdout.trajectories) == ("split", published)
        assert holdout.scenes == ("scene1", "scene3")
    with pytest.raises(InputError, match="no episode has a published"):
        hold_out(recipe_of(recipe(holdout="split")), trajectories)
    assert hold_out(recipe_of(recipe(holdout="scene")), trajectories, published).by == "scene"


@pytest.mark.parametrize(
    ("train", "valid"),
    [
        ({"step": 3}, "'step' (did you mean steps?); valid: batch"),
        ({"steps": 0}, "1 or more"),
        ({"steps": "many"}, "valid: like"),
        ({"device": "tpu"}, "valid: auto, cpu, cuda"),
        ({"model": {"encoder": "vit"}}, "valid: compact, resnet18"),
        ({"model": {"channels": [4, "x"]}}, "whole numbers"),
        ({"size_px": 4}, "size_px 4"),
    ],
)
def test_invalid_settings_list_the_valid_ones(train: dict, valid: str) -> None:
    with pytest.raises((InputError, UnknownNameError)) as caught:
        train_config(train)
    assert valid in str(caught.value)


def test_pretrained_encoders_come_from_a_file(episodes: CachedSequences, tmp_path: Path) -> None:
    from torchvision.models import resnet18

    path = tmp_path / "resnet.pt"
    weights = resnet18(weights=None).state_dict()
    torch.save(weights, path)
    model = ModelConfig(
        encoder="resnet18", encoder_weights=str(path), train_encoder=False, channels=(4, 8)
    )
    agent = MODELS["cma"](20, model).eval()
    first = next(iter(agent.senses.rgb.state_dict().values()))
    torch.testing.assert_close(first, weights["conv1.weight"])
    assert agent(collate_sequences([episodes[0]]))["action"].shape[-1] == 4
    agent.train()
    before = {k: v.clone() for k, v in agent.senses.rgb.state_dict().items()}
    optimizer = torch.optim.AdamW(agent.parameters(), 0.1, weight_decay=0.5)
    agent(collate_sequences([episodes[0]]))["action"].square().sum().backward()
    optimizer.step()
    for name, value in agent.senses.rgb.state_dict().items():  # buffers, too
        assert torch.equal(value, before[name]), name
    depth, rgb = agent.senses.depth, agent.senses.rgb.stages
    assert isinstance(depth, torch.nn.Module) and isinstance(rgb, torch.nn.Module)
    assert depth.training and not rgb.training
    path.write_bytes(b"no weights")
    with pytest.raises(InputError, match=r"resnet\.pt"):
        MODELS["cma"](20, model)


def test_a_policy_has_the_rig_that_all_its_data_was_seen_from(tmp_path: Path) -> None:
    names = ("ego", "rig:125cm_30deg", "rig:60cm_15deg:level", "chase")
    data = {n: select_all([write_dataset(tmp_path, "h1", [0.5], camera=n)]) for n in names}
    assert [view_of([seen]).camera for seen in data.values()] == [
        "ego:96x64:90",
        "rig:125cm_30deg:96x64:90",
        "rig:60cm_15deg:level:96x64:90",
        "ego:96x64:90",
    ]
    assert view_of([data["rig:125cm_30deg"]] * 2).camera == "rig:125cm_30deg:96x64:90"
    assert view_of([data[n] for n in names[1:3]]).camera == "ego:96x64:90"


def test_a_calibrated_camera_is_the_simulated_one(tmp_path: Path) -> None:
    simulated, recorded, other = (
        select_all([write_dataset(tmp_path, "h1", [0.5], hfov_deg=fov)])
        for fov in (90.0, 89.7, 87.0)
    )
    assert view_of([recorded, simulated]).camera == "ego:96x64:90"
    with pytest.raises(InputError, match="several cameras"):
        view_of([other, simulated])


def test_defaults_are_valid() -> None:
    assert train_config({}) == TrainConfig()
