"""`vlnpe adapt`: fine-tune a policy in a building of the user, and test it there."""

import sys
from collections import Counter
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ....formats.core.atomic import sweep, write_bytes
from ....formats.core.episode import Episode
from ....formats.core.errors import InputError, SceneError
from ....formats.core.rollout import EndReason
from ....formats.lerobot.splits import TRAIN
from ....formats.scene.bundle import SceneBundle, load_bundle
from ....formats.vlnce.files import write_episodes
from ....learning.card import Card, card_path, read_card
from ....trajectory_sampler.level import regions_of
from ...collect.command import run as collect
from ...collect.command import sources_of
from ...engine.lock import lock
from ...engine.run_folder import safe_name
from ...inputs.crews import chosen_robots
from ...inputs.episode_file import episodes_of
from ...options.collect import Collect
from ...options.evaluate import Evaluate
from ...options.shared import settings_of
from ...options.training import Adapt
from ...summary import print_result
from .threads import start_torch

LEAST_ROOMS = 3  # one is set aside, and the others are not all alike
HELD_OUT = "val_seen"  # split of the paths that are set aside: the building is seen, the goals not
BUILDING, PATHS, WALKS, TRAINING = "building", "paths", "walks", "training"  # folders
BEFORE, AFTER = "before", "after"


@dataclass(frozen=True)
class Parts:
    """The paths of a building, by what they are for.

    Attributes:
        rooms: rooms whose goals are set aside.
        others: rooms whose goals are trained on.
    """

    train: Sequence[Episode]
    held: Sequence[Episode]
    rooms: Sequence[str]
    others: Sequence[str]


def run(options: Adapt) -> int:
    """Adapt the policy, and print what was gained and how to use the checkpoint."""
    robots = chosen_robots(options.robot)
    scenes = list(sources_of(Collect(scene=options.scene, seed=options.seed), [], ""))
    if len(robots) != 1 or len(scenes) != 1:
        raise InputError(
            f"{options.scene}, --robot {options.robot}: a policy is adapted to one building and "
            "one robot"
        )
    start_torch(options.threads)
    from .adapt_page import answer, doubts, usage, write_page

    start, card = _start(options)
    out = options.out or Path("runs") / safe_name(f"adapt-{scenes[0]}-{robots[0].name}")
    out.mkdir(parents=True, exist_ok=True)
    with lock(out), redirect_stdout(sys.stderr):
        sweep(out)
        value = _adapt(options, start, card, scenes[0], out)
        page = write_page(out, value)
    lines = [answer(value), *(f"doubt: {text}" for text in doubts(value)), *usage(value)]
    facts = {k: value[k] for k in ("checkpoint", "before", "after", "difference", "held_rooms")}
    facts |= {"out": str(out), "doubts": doubts(value), "report": str(page)}
    return print_result(replace(options, out=out), facts, "\n".join([*lines, f"report:   {page}"]))


def _start(options: Adapt) -> tuple[Path, Card]:
    """Return the checkpoint to start from.

    Raises:
        InputError: The policy is no checkpoint, or one of a model that cannot learn from the walks.
    """
    from ....evaluation.policies.registry import resolve_policy
    from .train import RDP

    policy = resolve_policy(options.policy)
    if policy.checkpoint is None:
        raise InputError(f"--policy {options.policy}: valid: a checkpoint, such as cma-robots-32px")
    policy.identity()  # a damaged checkpoint is reported before anything is collected
    card, _ = read_card(policy.checkpoint)
    if card.config.model.name == RDP:
        raise InputError(
            f"--policy {options.policy}: {RDP} learns from waypoints, and these walks have "
            "discrete actions; valid: a checkpoint of cma or seq2seq"
        )
    return policy.checkpoint, card


def _adapt(options: Adapt, start: Path, card: Card, scene: str, out: Path) -> dict[str, Any]:
    """Run all stages; what is finished and unchanged is reused. Return the report's values."""
    from ....evaluation.policies.names import ORACLE
    from ....evaluation.results import compare, interval_json, summarise
    from ...collect.evaluation import chosen_trial, evaluate_policy
    from .loop import walked

    building = out / BUILDING
    collect(
        settings_of(
            Collect, options, episodes=str(options.paths), only_episodes=True, out=building
        )
    )  # fmt: skip
    episodes, scenes = episodes_of(building, None, None)
    parts = split_by_room(load_bundle(scenes / scene), episodes, options.seed)
    files = {TRAIN: parts.train, HELD_OUT: parts.held}
    for split, some in files.items():
        write_episodes(out / PATHS / f"{split}.json.gz", some)
    walks = settings_of(
        Evaluate,
        options,
        policy=ORACLE,
        episodes=out / PATHS / f"{TRAIN}.json.gz",
        scenes=scenes,
        camera=card.view.camera,
        out=None,
    )
    before = evaluate_policy(_test(walks, options.policy, out / BEFORE))
    _, ends = walked(chosen_trial(walks), walks, out / WALKS, options.workers)
    if not (arrived := ends[str(EndReason.SUCCESS)]):
        raise InputError(
            f"none of the expert's {len(parts.train)} walks ended at its goal; {out / WALKS} has "
            "them; valid: another --robot or --controller"
        )
    trained = _train(options, start, card, parts, out)
    checkpoint = out / f"{card.config.model.name}-{scene}.safetensors"
    write_bytes(card_path(checkpoint), card_path(trained).read_bytes())
    write_bytes(checkpoint, trained.read_bytes())
    after = evaluate_policy(_test(walks, str(checkpoint), out / AFTER))
    change = compare(before.results, after.results, (BEFORE, AFTER))
    tokens = [card.tokens.encode(episode.instruction) for episode in parts.held]
    unknown = 0 if card.config.model.frozen_language else sum(int((t == 1).sum()) for t in tokens)
    return {
        "scene": scene,
        "policy": options.policy,
        "robot": options.robot,
        "controller": after.results["setting"]["controller"],
        "checkpoint": str(checkpoint),
        "held_file": str(out / PATHS / f"{HELD_OUT}.json.gz"),
        "scenes": str(scenes),
        "asked": options.paths,
        "train": len(parts.train),
        "held": len(parts.held),
        "held_rooms": list(parts.rooms),
        "rooms": list(parts.others),
        "arrived": arrived,
        "steps": options.steps,
        "unknown": unknown / sum(int((t > 0).sum()) for t in tokens),
        **{
            name: {k: interval_json(v) for k, v in summarise(some.results["episodes"]).items()}
            for name, some in ((BEFORE, before), (AFTER, after))
        },
        "difference": {k: interval_json(v) for k, v in change.differences.items()},
        "failed": len(before.results["quarantined"]) + len(after.results["quarantined"]),
    }


def _test(walks: Evaluate, policy: str, out: Path) -> Evaluate:
    """Return the options by which a policy walks the paths that are set aside."""
    held = walks.episodes.with_name(f"{HELD_OUT}.json.gz")
    return replace(walks, policy=policy, episodes=held, camera=Evaluate.camera, films=1, out=out)


def _train(options: Adapt, start: Path, card: Card, parts: Parts, out: Path) -> Path:
    """Fine-tune on the expert's walks with the checkpoint's own settings; return the weights."""
    from ....datasets.mixture.recipe import Mixture, Recipe, Source
    from ....learning.training.holdout import Holdout
    from ....learning.training.plan import Request, plan_training
    from ....learning.training.session import train_once

    title = f"{options.policy} adapted to {parts.train[0].scene_id}"
    config = card.config.to_json() | {
        "steps": options.steps,
        "checkpoint_every": options.steps,
        "learning_rate": options.learning_rate,
        "instructions": "any",
    }
    recipe = Recipe(
        title, {WALKS: Source(("lerobot/*",))}, {WALKS: Mixture({WALKS: 1.0})},
        seed=options.seed, train=config,
    )  # fmt: skip
    held = frozenset(f"{e.scene_id}/{e.trajectory_id}" for e in parts.held)
    request = Request(
        recipe, out / WALKS, out / TRAINING, start=start, cache=out / TRAINING / "cache",
        holdout=Holdout("room of the goal", (), held),
    )  # fmt: skip
    return train_once(request, plan_training(request), options.seed)


def split_by_room(bundle: SceneBundle, episodes: Sequence[Episode], seed: int) -> Parts:
    """Set the paths aside that end in some of the rooms; see `rooms_aside`.

    Raises:
        SceneError: There are too few rooms or paths for a fair test.
    """
    from ....evaluation.statistics import LEAST_PATHS
    from ....learning.training.holdout import rooms_aside

    rooms = goal_rooms(bundle, episodes)
    chosen = rooms_aside(Counter(rooms), seed)
    held = [
        replace(episode, split=HELD_OUT)
        for episode, room in zip(episodes, rooms, strict=True)
        if room in chosen
    ]
    if len(set(rooms)) < LEAST_ROOMS or len(held) < LEAST_PATHS:
        raise SceneError(
            f"{bundle.root.name}: too small for a fair test: rooms in which its {len(episodes)} "
            f"paths end: {len(set(rooms))}; paths to set aside by room: {len(held)}; "
            f"valid: at least {LEAST_ROOMS} rooms and {LEAST_PATHS} such paths. Shorter paths "
            "(--min-length-m) may end in more rooms"
        )
    train = [episode for episode, room in zip(episodes, rooms, strict=True) if room not in chosen]
    return Parts(train, held, chosen, sorted(set(rooms) - set(chosen)))


def goal_rooms(bundle: SceneBundle, episodes: Sequence[Episode]) -> list[str]:
    """Return a name for the room that each path ends in, another one for each room."""
    regions = regions_of(bundle)
    names = []
    for episode in episodes:
        own = episode.levels[-1]
        level = regions[own]
        number = int(level.at(episode.goal_position_world_m[:2]))
        kind = level.names[number] if number >= 0 else ""
        floor = f" of level {own}" if len(regions) > 1 else ""
        names.append(f"{kind or 'room'} {number}{floor}" if number >= 0 else f"no room{floor}")
    return names
