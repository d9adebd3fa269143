"""Why RDP is worse than CMA: its diffusion head beside two others, on equal features.

    python -m benchmarks.evidence.heads DATASET … --test DATASET …     (folders of LeRobot)

Features are the last recurrent state of `cma-robots-32px`, not trained further. On them are
trained, with equal draws and steps: RDP's diffusion head (a decoder that removes the noise from the
next eight motions), the same decoder as a regression (no noise goes in, the motions come out), and
a classification of the action. What a head would do at each step of the expert's walks in other
homes is compared with what the expert did; motions become actions as in closed loop. The mean of
four draws of the diffusion tells what its chance costs.

Measured with the Aliengo's walks of robots.yaml (120 in `training`; 57 of `homes-0`, 2,753 steps),
in % of all actions, of turns, of stops: diffusion 71.7, 31.2, 6.1; the mean of draws 73.2, 23.1,
0.9; regression 73.5, 22.6, 0.0; classification 78.4, 47.4, 37.7, which is +6.7 (4.9 to 8.6), +16.2
(11.1 to 21.6) and +31.6 (17.7 to 45.6) over diffusion. The intervals do not cover other trainings;
the features were trained beside a classification and a regression, not beside a diffusion.
"""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import cross_entropy

from vlnpe.datasets.selection import select_all
from vlnpe.datasets.sequences import ACTIONS, EpisodeSequences, SequenceConfig, collate_sequences
from vlnpe.evaluation.policies.names import shipped_policies
from vlnpe.evaluation.statistics import clustered_interval
from vlnpe.formats.core.rollout import Action, EndReason
from vlnpe.learning.checkpoint import load_checkpoint
from vlnpe.learning.config import ModelConfig
from vlnpe.learning.models.cma import Cma
from vlnpe.learning.models.rdp import FUTURE, Rdp, future_motions, still
from vlnpe.learning.stepper import discrete_plan

SEEDS, STEPS, BATCH, RATE, DRAWS = 2, 1000, 128, 1e-3, 4


@dataclass(frozen=True)
class Walk:
    """The T steps of one of the expert's walks.

    Attributes:
        state: (T, H) features.
        motion, known: (T, 8, 3) next motions, and (T, 8) whether they are known.
        action: (T,) of the expert.
        place: its scene, and its path there.
    """

    state: Tensor
    motion: Tensor
    known: Tensor
    action: Tensor
    place: tuple[str, str]


@torch.no_grad()
def read(folders: Sequence[Path]) -> list[Walk]:
    """Return the successful walks of some datasets."""
    checkpoint = load_checkpoint(shipped_policies()["cma-robots-32px"])
    model, card = checkpoint.model, checkpoint.card
    assert isinstance(model, Cma)
    states: list[Tensor] = []
    model.second.register_forward_hook(lambda _module, _inputs, output: states.append(output[0][0]))
    chosen = select_all(folders)
    chosen = chosen.take(chosen.labels("end_reason") == str(EndReason.SUCCESS))
    config = SequenceConfig(card.config.size_px, card.config.max_steps, future=FUTURE)
    walks = []
    sequences = EpisodeSequences(chosen, card.tokens, config)
    for number in range(len(sequences)):
        batch = collate_sequences([sequences[number]])
        model(batch)
        motion, known = future_motions(batch)
        entry = chosen.take(np.arange(len(chosen)) == number)
        place = (str(entry.labels("scene_id")[0]), str(entry.trajectories()[0]))
        walks.append(Walk(states[-1], motion[0], known[0], batch["action"][0], place))
    return walks


class Heads(Rdp):
    """RDP's decoder in two parts, and a classification, behind one layer over the features."""

    def __init__(self, hidden: int):
        """Build them with the sizes of RDP's recipe."""
        super().__init__(1, ModelConfig(name="rdp", channels=(8,), hidden=hidden, dropout=0.1))
        self.act = nn.Linear(hidden, ACTIONS)

    def error(self, head: str, walks: Sequence[Tensor]) -> Tensor:
        """Return the loss of a head on states, motions, whether these are known, and actions."""
        state, motion, known, action = walks
        if head == "classification":
            return cross_entropy(self.act(self.encode(state[:, None])[:, 0]), action)
        clean = (motion / self.scale).clamp(-1.0, 1.0)
        if head == "regression":
            wrong = self.regress(state) / self.scale - clean
        else:
            noise = torch.randn_like(clean)
            level = torch.randint(self.schedule.steps, (len(clean),))
            noisy = self.schedule.add_noise(clean, noise, level)
            wrong = self._denoise(self.encode(state[:, None]), noisy, level) - noise
        return (wrong.square().mean(-1) * known).sum() / known.sum()

    def regress(self, state: Tensor) -> Tensor:
        """Return motions (N, 8, 3) of states (N, H)."""
        nothing = state.new_zeros(len(state), FUTURE, 3)
        level = torch.zeros(len(state), dtype=torch.long)
        return self.scale * self._denoise(self.encode(state[:, None]), nothing, level)

    def draw(self, state: Tensor, count: int) -> Tensor:
        """Return the mean of so many draws of motions (N, 8, 3)."""
        rng = torch.Generator().manual_seed(0)
        return torch.stack([self.sample(state[:, None], rng) for _ in range(count)]).mean(0)


def trained(head: str, walks: Sequence[Walk], seed: int) -> Heads:
    """Return the heads with one of them trained."""
    torch.manual_seed(seed)
    model = Heads(walks[0].state.shape[1])
    rng = torch.Generator().manual_seed(seed)
    parts = zip(*((w.state, w.motion, w.known, w.action) for w in walks), strict=True)
    data = [torch.cat(part) for part in parts]
    optimiser = torch.optim.AdamW(model.parameters(), RATE, weight_decay=0.02)
    fall = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, STEPS)
    for _ in range(STEPS):
        drawn = torch.randint(len(data[0]), (BATCH,), generator=rng)
        loss = model.error(head, [values[drawn] for values in data])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        fall.step()
    return model.eval()


def planned(motions: Tensor) -> Tensor:
    """Return the first actions (N,) of plans (N, 8, 3)."""
    stops = still(motions).tolist()
    plans = zip(motions.numpy(), stops, strict=True)
    return torch.tensor([int(Action.STOP if s else discrete_plan(m)[0]) for m, s in plans])


ROWS: dict[str, tuple[str, Callable[[Heads, Tensor], Tensor]]] = {
    "diffusion": ("diffusion", lambda m, s: planned(m.draw(s, 1))),
    "diffusion, mean of draws": ("diffusion", lambda m, s: planned(m.draw(s, DRAWS))),
    "regression": ("regression", lambda m, s: planned(m.regress(s))),
    "classification": (
        "classification",
        lambda m, s: m.act(m.encode(s[:, None])[:, 0]).argmax(-1),
    ),
}


def main() -> None:
    """Print what each row gets right, and the differences from the first one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", nargs="+", type=Path)
    parser.add_argument("--test", nargs="+", type=Path, required=True)
    options = parser.parse_args()
    walks, tests = read(options.data), read(options.test)
    right: dict[str, list[list[np.ndarray]]] = {row: [] for row in ROWS}
    for seed in range(SEEDS):
        models = {head: trained(head, walks, seed) for head in {h for h, _ in ROWS.values()}}
        with torch.no_grad():
            for row, (head, choose) in ROWS.items():
                right[row].append(
                    [(choose(models[head], w.state) == w.action).numpy() for w in tests]
                )
    scenes, paths = zip(*(w.place for w in tests), strict=True)

    def interval(values: Sequence[float]) -> str:
        known = [k for k, value in enumerate(values) if np.isfinite(value)]
        chosen, places, routes = (
            [values[k] for k in known],
            [scenes[k] for k in known],
            [paths[k] for k in known],
        )
        found = clustered_interval(chosen, places, routes, np.random.default_rng(0))
        return f"{found.mean:.1f} ({found.low:.1f} to {found.high:.1f})"

    kinds = {"all": range(ACTIONS), "turns": (2, 3), "stops": (0,)}
    result = {"walks": [len(walks), len(tests)], "steps": sum(len(w.action) for w in tests)}
    for row, seeds in right.items():
        for kind, actions in kinds.items():
            hits = {
                name: [
                    100.0 * float(np.mean([h[np.isin(w.action, list(actions))] for h in hits]))
                    for w, *hits in zip(tests, *many, strict=True)
                ]
                for name, many in ((row, seeds), ("diffusion", right["diffusion"]))
            }
            apart = [a - b for a, b in zip(hits[row], hits["diffusion"], strict=True)]
            result[f"{row}, {kind}"] = f"{interval(hits[row])}; {interval(apart)}"
    sys.stdout.write(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
