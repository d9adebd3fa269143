"""Trained models meet in closed loop what they met in training, and do there what they learned."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from tests.learning.conftest import Walks
from vlnpe.collectors.replay.replay import ReplayConfig
from vlnpe.collectors.replay.world import open_world
from vlnpe.collectors.robots import get_robot
from vlnpe.datasets.mixture.recipe import recipe_of
from vlnpe.datasets.selection import select_all
from vlnpe.datasets.sequences import EpisodeSequences, SequenceConfig, collate_sequences
from vlnpe.evaluation.episode import closed_loop, evaluate_episode
from vlnpe.evaluation.observation import Eye
from vlnpe.evaluation.policies.learned import LearnedPolicy
from vlnpe.evaluation.policies.names import shipped_policies
from vlnpe.formats.core.rollout import Action, Rollout
from vlnpe.learning.card import Card, View
from vlnpe.learning.checkpoint import Checkpoint, load_checkpoint
from vlnpe.learning.config import ModelConfig, TrainConfig
from vlnpe.learning.models.rdp import FUTURE, future_motions
from vlnpe.learning.models.registry import build_model
from vlnpe.learning.stepper import Choice, Sight, Stepper, discrete_plan
from vlnpe.learning.training.plan import Request
from vlnpe.learning.training.session import train_recipe
from vlnpe.rendering.camera.views import make_view
from vlnpe.rendering.registry import make_renderer

SMALL = {"channels": [8, 16], "hidden": 48, "words": 16, "dropout": 0.0, "layers": 1}
RECIPE: dict[str, Any] = {
    "recipe": 1,
    "sources": {"walks": {"robots": ["vlnce"], "outcomes": []}},
    "mixtures": {"walks": ["walks"]},
    "holdout": "none",
    "train": {
        "batch": 2,
        "size_px": 24,
        "learning_rate": 0.005,
        "unknown": 0.0,
        "tokens": 12,
        "device": "cpu",
        "checkpoint_every": 500,
    },
}


def request(walks: Walks, out: Any, steps: int, **model: Any) -> Request:
    recipe = {**RECIPE, "train": {**RECIPE["train"], "steps": steps, "model": SMALL | model}}
    return Request(recipe_of(recipe), walks.root, out)


class Watched:
    """Records what a policy would predict while the expert's actions are taken."""

    blind = False

    def __init__(self, checkpoint: Checkpoint, actions: list[Action]):
        self.stepper, self.actions = Stepper(checkpoint), actions
        self.reads_px: int | None = None
        self.sizes: set[tuple[int, ...]] = set()
        self.predicted: list[dict[str, torch.Tensor]] = []

    def reset(self, assignment: Any) -> None:
        self.stepper.begin(assignment.instruction, assignment.episode_id)

    def act(self, seen: Any) -> Action:
        sight = Sight(seen.rgb, seen.depth_m, seen.previous_action, seen.pose)
        self.sizes.add(seen.rgb.shape[:2])
        self.predicted.append(self.stepper.predict(sight))
        return self.actions[seen.step]


def walk(walks: Walks, number: int, policy: Any) -> Rollout:
    world = open_world(walks.scene, 0, get_robot("vlnce"))
    eye = Eye(world, walks.view, make_renderer(walks.scene, "embree", light="baked"))
    config = closed_loop(ReplayConfig(robot="vlnce", controller="flash"))
    return evaluate_episode(world, walks.episodes[number], config, policy, eye)


# Of colours the codec loses a part; depth is only quantised.
@pytest.mark.parametrize("inputs", [("rgb", "depth", "instruction"), ("depth", "instruction")])
@pytest.mark.parametrize("name", ["cma", "seq2seq", "rdp"])
def test_the_agent_sees_inputs_like_the_loaders(
    walks: Walks, name: str, inputs: tuple[str, ...]
) -> None:
    selection = select_all([walks.root / "lerobot" / "vlnce"])
    model = ModelConfig(name=name, inputs=inputs, hidden=32, channels=(8, 16))
    config = TrainConfig(size_px=24, tokens=12, model=model)
    words = ("<pad>", "<unk>", "go", "to", "the", "table", "turn", "right", ".")
    card = Card(config, words, View(48, 48, 90.0, 20.0))
    torch.manual_seed(0)
    checkpoint = Checkpoint(card, build_model(card.tokens, model).eval(), "")
    sequences = EpisodeSequences(selection, card.tokens, SequenceConfig(24, future=FUTURE))
    key = "progress" if name == "rdp" else "action"
    for number, rollout in enumerate(walks.rollouts):
        item = sequences[number]
        actions = [span.action for span in rollout.actions]
        assert item["action"].tolist() == actions  # flash: the steps are the executed actions
        watched = Watched(checkpoint, actions)
        assert len(walk(walks, number, watched).actions) == len(actions)
        with torch.no_grad():
            batch = collate_sequences([item])
            read = checkpoint.model.reader(batch["tokens"])
            trained, _ = checkpoint.model.advance(read, batch, None)
        live = torch.cat([p[key] for p in watched.predicted], 1)
        assert live.shape == trained[key].shape
        spread = float(trained[key].std(1).mean())
        apart = float((live - trained[key]).abs().max()) / spread
        assert apart < (0.5 if "rgb" in inputs else 0.02), apart


def test_an_unmeasured_ceiling_looks_like_the_wall_below_it() -> None:
    checkpoint = load_checkpoint(shipped_policies()["cma"])
    rng = np.random.default_rng(0)
    rgb = rng.integers(0, 255, (32, 32, 3), np.uint8)
    walls = rng.uniform(0.5, 9.0, (32, 32)).astype(np.float32)
    walls[:12], walls[20, 4:9], walls[30:, 7] = walls[12], walls[21, 4:9], 0.0
    open_top = walls.copy()
    open_top[:12, ::2], open_top[20, 4:9] = 0.0, 0.0  # nothing is measured below row 30

    def logits(depth_m: np.ndarray) -> torch.Tensor:
        stepper = Stepper(checkpoint)
        stepper.begin("go to the table.", "one")
        return stepper.predict(Sight(rgb, depth_m, -1, np.zeros(3)))["action"]

    assert torch.equal(logits(open_top), logits(walls))
    assert not torch.equal(logits(np.zeros_like(walls)), logits(walls))


def test_pictures_drawn_for_a_model_are_worth_the_whole_ones(walks: Walks) -> None:
    checkpoint = load_checkpoint(shipped_policies()["cma"])
    view = make_view("ego", "vlnce", width_px=128, height_px=128)
    walked = replace(walks, view=view)
    for number, rollout in enumerate(walks.rollouts):
        predicted = []
        for reads_px in (LearnedPolicy(checkpoint).reads_px, None):
            watched = Watched(checkpoint, [span.action for span in rollout.actions])
            watched.reads_px = reads_px
            walk(walked, number, watched)
            side = 128 if reads_px is None else 64
            assert watched.sizes == {(side, side)}
            predicted.append(torch.cat([p["action"] for p in watched.predicted], 1))
        drawn, whole = predicted
        assert float((drawn - whole).abs().max() / whole.std(1).mean()) < 0.5


@pytest.mark.parametrize("name", ["cma", "seq2seq"])
def test_a_fitted_model_goes_where_the_words_say(walks: Walks, name: str, tmp_path: Any) -> None:
    result = train_recipe(request(walks, tmp_path, 160, name=name), show=False)
    policy = LearnedPolicy.load(result.checkpoint)
    ends = []
    for number, rollout in enumerate(walks.rollouts):
        walked = walk(walks, number, policy)
        assert walked.actions[-1].action is Action.STOP
        ends.append(walked.position_world_m[-1, :2])
        assert np.linalg.norm(ends[-1] - rollout.position_world_m[-1, :2]) < 0.8
    assert np.linalg.norm(ends[0] - ends[1]) > 1.0
    if name == "cma":  # the other one's words lead to the other one's place
        episode = replace(walks.episodes[0], instruction=walks.episodes[1].instruction)
        swapped = replace(walks, episodes=[episode])
        assert np.linalg.norm(walk(swapped, 0, policy).position_world_m[-1, :2] - ends[1]) < 0.8


def test_a_diffusion_policy_learns_and_repeats_itself_by_its_seed(
    walks: Walks, tmp_path: Any
) -> None:
    base = request(walks, tmp_path, 60, name="rdp")
    often = {**base.recipe.train, "checkpoint_every": 10}
    result = train_recipe(replace(base, recipe=replace(base.recipe, train=often)), show=False)
    assert result.curves[-1]["train loss"] < 0.6 * result.curves[0]["train loss"]
    first, again = (walk(walks, 0, LearnedPolicy.load(result.checkpoint)) for _ in range(2))
    assert [a.action for a in first.actions] == [a.action for a in again.actions]
    other = walk(walks, 0, LearnedPolicy.load(result.checkpoint, Choice(seed=1)))
    assert [a.action for a in first.actions] != [a.action for a in other.actions]
    assert len(first.actions) < 500  # its stop head stops it


def test_motions_stand_still_behind_the_end_and_are_unknown_behind_a_cut(walks: Walks) -> None:
    selection = select_all([walks.root / "lerobot" / "vlnce"])
    card = Card(TrainConfig(tokens=8), ("<pad>", "<unk>"), View(48, 48, 90.0, 20.0))
    for most in (200, 6):
        how = SequenceConfig(images=False, max_steps=most, future=FUTURE)
        batch = collate_sequences([EpisodeSequences(selection, card.tokens, how)[0]])
        motions, valid = future_motions(batch)
        length = int(batch["length"][0])
        inside = np.add.outer(np.arange(length), np.arange(FUTURE)) < length - 1
        assert np.array_equal(valid[0].numpy(), inside | (most == 200))
        assert not motions[0][~torch.from_numpy(inside)].any()
        torch.testing.assert_close(motions[0, 2, 1], batch["motion"][0, 3])


def test_plans_of_noisy_motions_are_the_actions_they_are_near_to() -> None:
    rng = np.random.default_rng(0)
    step, turn = (0.25, 0.0, 0.0), (0.0, 0.0, np.pi / 12)
    motions = np.array([step, step, turn, step, turn, turn, step, step])
    plan = discrete_plan((motions + rng.normal(0, 0.01, motions.shape)).astype(np.float32))
    assert plan == [Action.FORWARD, Action.FORWARD, Action.LEFT, Action.FORWARD]
    assert discrete_plan(np.full((8, 3), (0.01, 0.0, 0.0), np.float32)) == [Action.FORWARD]
    assert discrete_plan(np.full((8, 3), (0.0, 0.0, -0.01), np.float32)) == [Action.RIGHT]


def test_a_checkpoint_comes_back_as_it_was(walks: Walks, tmp_path: Any) -> None:
    result = train_recipe(request(walks, tmp_path, 2), show=False)
    first, again = load_checkpoint(result.checkpoint), load_checkpoint(result.checkpoint)
    assert first.card == again.card and first.card.steps == 2
    assert first.card.robots == ("vlnce",) and first.card.view == View(48, 48, 90.0, 20.0)
    assert first.card.curves[-1]["step"] == 2 and "train action" in first.card.curves[-1]
    assert {"go", "table", "right"} <= set(first.card.words)
    for name, value in first.model.state_dict().items():
        assert torch.equal(value, again.model.state_dict()[name])
