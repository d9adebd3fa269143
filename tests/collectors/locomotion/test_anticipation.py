"""A gait that anticipates delays: its network, its past, and how it learns."""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="extra `train` is not installed")

from vlnpe.collectors.locomotion.runtime import GaitPolicy
from vlnpe.collectors.locomotion.runtime.card import save_card
from vlnpe.collectors.locomotion.runtime.network import Mlp, decode_layers, encode_layers
from vlnpe.collectors.locomotion.runtime.observation import layout, past_steps
from vlnpe.collectors.locomotion.runtime.policy import policy_files
from vlnpe.collectors.locomotion.training import anticipate
from vlnpe.collectors.locomotion.training.correction import HIDDEN, PAST, Correction, beside
from vlnpe.collectors.locomotion.training.mirror import Symmetry
from vlnpe.collectors.locomotion.training.stairs.base import layers_of
from vlnpe.collectors.locomotion.trials.trial import Conditions, Trial
from vlnpe.collectors.robots import get_robot

ROBOT = get_robot("aliengo")
JOINTS = ROBOT.policy_joints


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the gait inside the installed one, which anticipates delays."""
    folder = tmp_path_factory.mktemp("plain")
    weights, biases = layers_of(ROBOT)
    seen = layout(JOINTS)
    columns = sum(width for _, width in seen)
    for i, weight in enumerate(weights):
        # The correction stands below and to the right, together with its mirror image.
        rows = JOINTS if i == len(weights) - 1 else len(weight) - 2 * HIDDEN
        weights[i], biases[i] = weight[:rows, :columns], biases[i][:rows]
        columns = rows
    content = encode_layers(weights, biases)
    network, card = policy_files(ROBOT, folder)
    network.write_bytes(content)
    digest = hashlib.sha256(content).hexdigest()
    save_card(replace(GaitPolicy.load(ROBOT).card, observation=seen, network_sha256=digest), card)
    return folder


def run(weights: list[np.ndarray], biases: list[np.ndarray], seen: np.ndarray) -> np.ndarray:
    """What the layers make of observations (N, D), with ELU between them."""
    network = Mlp(*decode_layers(Path("policy.safetensors"), encode_layers(weights, biases)))
    action = np.zeros((len(seen), network.outputs), dtype=np.float32)
    network.run(seen.astype(np.float32), action)
    return action


def layers(rng: np.random.Generator, *sizes: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    pairs = list(zip(sizes[1:], sizes[:-1], strict=True))
    return [rng.normal(0, 0.5, pair) for pair in pairs], [rng.normal(0, 1, a) for a, _ in pairs]


def test_two_networks_beside_each_other_are_their_sum() -> None:
    rng = np.random.default_rng(0)
    small, large = layers(rng, 5, 8, 6, 3), layers(rng, 9, 7, 4, 3)
    seen = rng.normal(0, 1, (20, 9))
    np.testing.assert_allclose(
        run(*beside(small, large), seen),
        run(*small, seen[:, :5]) + run(*large, seen),
        rtol=0,
        atol=1e-4,
    )


def test_the_blocks_say_how_many_steps_they_repeat() -> None:
    assert past_steps(layout(JOINTS, 4)) == 4 and past_steps(layout(JOINTS)) == 0


def test_a_tiny_training_resumes_and_its_gait_stands(
    plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(anticipate, "ROBOTS", 6)
    monkeypatch.setattr(anticipate, "SECONDS", 0.6)
    anticipate.anticipate(ROBOT, plain, tmp_path / "parts", rounds=1)
    anticipate.anticipate(ROBOT, plain, tmp_path / "parts", rounds=2)
    late = GaitPolicy.load(ROBOT, tmp_path / "parts")
    assert late.card.past == PAST
    assert late.card.training["anticipation"]["rounds"] == 2
    # It is as symmetric as the gait that it began with.
    mirror = Symmetry.of(ROBOT, PAST)
    seen = np.random.default_rng(1).normal(0, 1, (5, late.network.inputs))
    image = seen[:, mirror.observation_order] * mirror.observation_signs.numpy()
    action = late.infer(seen)[:, mirror.joint_order] * mirror.joint_signs.numpy()
    np.testing.assert_allclose(late.infer(image), action, rtol=0, atol=1e-4)
    trial = Trial(late, Conditions(), np.zeros((1, 2)), np.zeros(1), np.random.default_rng(0))
    assert not trial.fallen.any()
    with pytest.raises(SystemExit, match="anticipates delays already"):
        anticipate.anticipate(ROBOT, tmp_path / "parts", tmp_path / "again", rounds=1)


def test_an_untrained_correction_adds_nothing(plain: Path) -> None:
    gait = layers_of(ROBOT, plain)
    both = beside(gait, Correction(ROBOT).layers())
    seen = np.random.default_rng(2).normal(0, 1, (8, both[0][0].shape[1]))
    width = gait[0][0].shape[1]
    np.testing.assert_allclose(run(*both, seen), run(*gait, seen[:, :width]), rtol=0, atol=1e-4)


def test_actions_without_delay_need_no_correction(
    plain: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(anticipate, "ROBOTS", 6)
    monkeypatch.setattr(anticipate, "SECONDS", 0.6)
    gait = GaitPolicy.load(ROBOT, plain)
    for most, lacks in ((4, False), (14, True)):
        monkeypatch.setattr(anticipate, "LATE_SUBSTEPS", most)
        _, lacking = anticipate.walks(gait, Correction(ROBOT), np.random.default_rng(0))
        assert bool(np.abs(lacking).max() > 0.05) == lacks
