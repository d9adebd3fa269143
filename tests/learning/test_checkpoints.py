"""Checkpoints that are damaged or from elsewhere, and states of other trainings."""

import json
import os
import pickle
import shutil
from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
from safetensors.torch import load_file, save_file

from tests.learning.conftest import Walks
from tests.learning.test_closed_loop import request
from tests.security.hostile import put
from vlnpe.evaluation.policies.registry import resolve_policy
from vlnpe.formats.core.errors import FileFormatError, InputError, UnknownNameError
from vlnpe.learning import stepper as stepping
from vlnpe.learning.card import card_path, read_card
from vlnpe.learning.checkpoint import load_checkpoint
from vlnpe.learning.stepper import Choice, Sight, Stepper
from vlnpe.learning.training.session import train_recipe


@pytest.fixture(scope="module")
def trained(walks: Walks, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("trained")
    return train_recipe(request(walks, out, 1), show=False).checkpoint


def test_a_card_says_where_its_walks_were_and_if_one_took_stairs(
    walks: Walks, tmp_path: Path
) -> None:
    """Also one that the start was trained on; and nothing where the dataset does not tell."""

    def train(name: str, staircases: list[list[int]] | None, start: Path | None = None) -> Path:
        root = tmp_path / name
        shutil.copytree(walks.root / "lerobot", root / "lerobot")
        (path,) = (root / "lerobot").rglob("meta/episodes/**/*.parquet")
        table = pq.read_table(path)
        column, kind = table.column_names.index("staircases"), table.schema.field("staircases").type
        table = table.remove_column(column)
        if staircases is not None:
            table = table.append_column("staircases", pa.array(staircases, kind))
        pq.write_table(table, path)
        asked = replace(request(walks, root / "out", 1), data=root, start=start)
        return train_recipe(asked, show=False).checkpoint

    level, climbs = train("level", [[], []]), train("climbs", [[], [0]])
    unknown = train("unknown", None)
    made = [level, climbs, unknown]
    made += [train(f"from-{k}", [[], []], start) for k, start in enumerate(made)]
    assert [read_card(path)[0].stairs for path in made] == 2 * [False, True, None]
    assert {read_card(path)[0].scenes for path in made} == {("two_rooms",)}
    card = json.loads(card_path(level).read_text())
    del card["stairs"]
    card_path(level).write_text(json.dumps(card))
    assert read_card(level)[0].stairs is None  # an older one


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-40])


def no_weights(path: Path) -> None:
    path.write_bytes(pickle.dumps({"weights": [1.0]}))


def no_card(path: Path) -> None:
    path.with_suffix(".json").unlink()


def other_version(path: Path) -> None:
    card = json.loads(path.with_suffix(".json").read_text())
    path.with_suffix(".json").write_text(json.dumps(card | {"card": 99}))


def no_words(path: Path) -> None:
    card = json.loads(path.with_suffix(".json").read_text())
    path.with_suffix(".json").write_text(json.dumps(card | {"words": [1, 2]}))


def other_sizes(path: Path) -> None:
    card = json.loads(path.with_suffix(".json").read_text())
    card["config"]["model"]["hidden"] = 64
    path.with_suffix(".json").write_text(json.dumps(card))


def not_finite(path: Path) -> None:
    weights = load_file(path)
    next(iter(weights.values())).view(-1)[0] = float("nan")
    save_file(weights, path)
    card = json.loads(path.with_suffix(".json").read_text())
    card["weights_sha256"] = sha256(path.read_bytes()).hexdigest()
    path.with_suffix(".json").write_text(json.dumps(card))


def card_with(**changes: str) -> Callable[[Path], None]:
    """Return what puts JSON texts into a card."""

    def change(path: Path) -> None:
        place = path.with_suffix(".json")
        card = json.loads(place.read_text()) | dict.fromkeys(changes, "?")
        text = json.dumps(card)
        for name, value in changes.items():
            text = text.replace(f'"{name}": "?"', f'"{name}": {value}')
        place.write_text(text)

    return change


def flipped(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)


def sparse(path: Path) -> None:
    os.truncate(path, 60 << 30)


def valid_header_of_other_weights(path: Path) -> None:
    save_file({"a": torch.zeros(3)}, path)
    digest = sha256(path.read_bytes()).hexdigest()
    card_with(weights_sha256=f'"{digest}"')(path)


def fresh(path: Path) -> Path:
    path.unlink()
    return path


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (cut, "damaged"),
        (no_weights, "damaged"),
        (sparse, "is too large"),
        (flipped, "damaged"),
        (lambda path: path.with_suffix(".json").write_text("[" * 100_000), "nested too deeply"),
        (lambda path: put("a Git LFS pointer", fresh(path)), "git lfs pull"),
        (lambda path: put("a FIFO", fresh(path)), "is a FIFO"),
        (lambda path: put("a FIFO", fresh(path.with_suffix(".json"))), "is a FIFO"),
        (card_with(seed="1e400"), "seed"),
        (card_with(steps='"many"'), "steps"),
        (card_with(robots="3"), "robots"),
        (card_with(data="[3]"), "data"),
        (card_with(view="[]"), "not the card of a checkpoint"),
        (card_with(view='{"width_px": null}'), "width_px"),
        (card_with(config='{"model": {"hidden": 8000000000000}}'), "hidden 8000000000000; valid"),
        (card_with(config='{"model": {"hidden": 8e12}}'), "hidden"),
        (card_with(config='{"model": {"layers": 1000000000}}'), "layers"),
        (card_with(config='{"model": {"channels": [9000000000]}}'), "channels"),
        (valid_header_of_other_weights, "unexpected weights"),
        (card_with(config='{"model": {"hidden": 8192, "words": 4096}}'), "unexpected weights"),
        (no_card, "card"),
        (other_version, "card version 99; valid: 1"),
        (no_words, "vocabulary"),
        (other_sizes, "the card says"),
        (not_finite, "not finite"),
    ],
)
def test_damaged_checkpoints_are_refused_by_name(
    trained: Path, damage: Callable[[Path], None], reason: str, tmp_path: Path
) -> None:
    path = tmp_path / trained.name
    for suffix in (".safetensors", ".json"):
        shutil.copy(trained.with_suffix(suffix), tmp_path)
    load_checkpoint(path)
    damage(path)
    with pytest.raises(FileFormatError, match=reason) as caught:
        load_checkpoint(path)
    assert caught.value.path.stem == path.stem
    # `vlnpe evaluate` asks for this first: exit 2, and no item of an episode.
    with pytest.raises(InputError):
        resolve_policy(str(path)).identity()


def test_the_registry_knows_checkpoints_by_their_content(trained: Path, tmp_path: Path) -> None:
    before = resolve_policy(str(trained)).identity()
    assert resolve_policy(str(trained)).make(0).blind is False
    copy = tmp_path / trained.name
    for suffix in (".safetensors", ".json"):
        shutil.copy(trained.with_suffix(suffix), tmp_path)
    assert resolve_policy(str(copy)).identity() == before
    card_with(start='"other weights"')(copy)
    assert resolve_policy(str(copy)).identity() != before
    with pytest.raises(InputError, match="no such file"):
        resolve_policy("nowhere.safetensors")
    with pytest.raises(UnknownNameError, match="safetensors"):
        resolve_policy("nowhere")


def test_sampled_actions_follow_the_predicted_probabilities(trained: Path) -> None:
    checkpoint = load_checkpoint(trained)
    sight = Sight(np.zeros((48, 48, 3), np.uint8), np.zeros((48, 48), np.float32), -1, np.zeros(3))
    steppers = {sample: Stepper(checkpoint, Choice(sample, 3)) for sample in (True, False)}
    actions: dict[bool, list[int]] = {True: [], False: []}
    for sample, stepper in steppers.items():
        for number in range(200):
            stepper.begin("Go.", f"e{number}")
            actions[sample].append(int(stepper.act(sight)))
    steppers[True].begin("Go.", "e0")
    expected = steppers[True].predict(sight)["action"][0, 0].softmax(-1)
    counts = torch.bincount(torch.tensor(actions[True]), minlength=4) / 200
    assert (counts - expected).abs().max() < 0.12
    assert set(actions[False]) == {int(expected.argmax())}


def test_traced_steps_are_those_of_the_model_whatever_they_were_traced_with(
    trained: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(0)
    sights = [
        Sight(
            rng.integers(0, 255, (48, 48, 3), np.uint8),
            rng.random((48, 48), np.float32),
            number,
            np.zeros(3),
        )
        for number in (-1, 1, 2, 1)
    ]

    def predictions(stepper: Stepper, text: str) -> torch.Tensor:
        stepper.begin(text, "e")
        return torch.stack([stepper.predict(sight)["action"] for sight in sights])

    traced, plain = (Stepper(load_checkpoint(trained)) for _ in range(2))
    predictions(traced, "Go.")  # traces at its second sight, with one word
    monkeypatch.setattr(stepping, "_traced", lambda model, _: stepping._Advance(model))
    text = "Walk past the bed, turn left, and stop."
    assert torch.equal(predictions(traced, text), predictions(plain, text))


def test_a_compact_model_steps_in_one_thread(
    trained: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two threads that wait for each other made a closed-loop episode three times as slow."""
    stepper = Stepper(load_checkpoint(trained))
    seen: list[int] = []
    convolve = torch.nn.Conv2d.forward

    def spy(layer: torch.nn.Conv2d, images: torch.Tensor) -> torch.Tensor:
        seen.append(torch.get_num_threads())
        return convolve(layer, images)

    monkeypatch.setattr(torch.nn.Conv2d, "forward", spy)
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        stepper.begin("Go.", "e")
        stepper.act(
            Sight(np.zeros((48, 48, 3), np.uint8), np.zeros((48, 48), np.float32), -1, np.zeros(3))
        )
        assert set(seen) == {1} and torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_a_training_resumes_only_its_own_state_and_keeps_its_curves(
    walks: Walks, tmp_path: Path
) -> None:
    base = request(walks, tmp_path, 6)
    often = {**base.recipe.train, "checkpoint_every": 2}
    base = replace(base, recipe=replace(base.recipe, train=often))

    class KilledError(Exception):
        pass

    calls: list[int] = []

    def validate(model: object, card: object) -> dict[str, float]:
        calls.append(1)
        if len(calls) == 3:
            raise KilledError
        return {"SR": 50.0}

    with pytest.raises(KilledError):
        train_recipe(replace(base, validate=validate), show=False)
    resumed = train_recipe(replace(base, validate=validate), show=False)
    whole = train_recipe(replace(base, out=tmp_path / "whole"), show=False)
    assert [row["step"] for row in resumed.curves] == [2, 4, 6]
    for row, other in zip(resumed.curves, whole.curves, strict=True):
        assert {k: v for k, v in row.items() if k != "SR"} == other
    first, second = (load_checkpoint(r.checkpoint).model.state_dict() for r in (resumed, whole))
    for name, value in first.items():
        assert torch.equal(value, second[name]), name
    with pytest.raises(FileFormatError, match="other settings"):
        train_recipe(request(walks, tmp_path, 8), show=False)
    (tmp_path / "state.pt").write_bytes(b"no state")
    with pytest.raises(FileFormatError, match=r"state\.pt"):
        train_recipe(base, show=False)


def test_fine_tuning_keeps_vocabulary_and_architecture(
    walks: Walks, trained: Path, tmp_path: Path
) -> None:
    base = replace(request(walks, tmp_path, 1), start=trained)
    tuned = load_checkpoint(train_recipe(base, show=False).checkpoint)
    start = load_checkpoint(trained)
    assert tuned.card.words == start.card.words and tuned.card.start == start.sha256
    with pytest.raises(InputError, match="architecture"):
        train_recipe(replace(request(walks, tmp_path, 1, hidden=32), start=trained), show=False)
