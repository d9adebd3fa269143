"""Readers of robots, policies, results and replies."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from .target import Target, saved, typed


def _robot(name: str, folder: Path) -> Target:
    from tests.support.robot_folders import written_rover
    from vlnpe.collectors.robots.folder.load import load_robot_folder

    rover = written_rover(folder / "rover")
    seed = (rover / name).read_bytes()
    return Target([seed], saved(rover / name, lambda _: load_robot_folder(rover)))


def _onnx(folder: Path) -> Target:
    from tests.security.test_robot_folder import ONES, network, tensor
    from vlnpe.collectors.locomotion.runtime.onnx_runtime import OnnxNetwork

    path = folder / "policy.onnx"
    seeds = [network(weights=tensor(b"w", (4, 2), ONES))]
    return Target(seeds, lambda data: OnnxNetwork(path, data))


def _card(folder: Path) -> Target:
    from tests.security.test_robot_folder import CARD
    from vlnpe.collectors.locomotion.runtime.card import load_card
    from vlnpe.collectors.robots import get_robot

    robot = get_robot("aliengo")
    seeds = [json.dumps(CARD).encode()]
    path = folder / "policy.json"
    return Target(seeds, saved(path, lambda at: load_card(at).check(robot, at)))


def _policy_card(folder: Path) -> Target:
    from vlnpe.evaluation.policies.names import shipped_policies
    from vlnpe.learning.card import read_card

    seed = json.loads(shipped_policies()["cma"].with_suffix(".json").read_text())
    seed |= {"words": seed["words"][:4], "curves": seed["curves"][:1]}
    card = saved(folder / "a.json", lambda path: read_card(path.with_suffix(".safetensors")))
    return Target([json.dumps(seed).encode()], card)


def _results(folder: Path) -> Target:
    from tests.evaluation.test_statistics import EPISODE
    from vlnpe.evaluation.results import compare, read_results

    good = {"format": "vlnpe-results/1", "setting": {"gait_sha256": "a"}, "episodes": [EPISODE]}

    def read(path: Path) -> None:
        compare(good, read_results(path), ("good", "a"))

    return Target([json.dumps(good).encode()], saved(folder / "results.json", read))


def _hello(folder: Path) -> Target:
    from vlnpe.evaluation.server import decode, encode

    hello = {"protocol": "vlnpe-policy/1", "images": True, "version": "a", "a": np.zeros(3)}
    return Target([encode(hello)], typed(decode))


def _reply(folder: Path) -> Target:
    from openai.types.chat import ChatCompletion

    from vlnpe.instruction_gen.llm.answers import Answer, read_answer
    from vlnpe.instruction_gen.llm.reply import ReplyError, content_of, usage_of
    from vlnpe.instruction_gen.llm.settings import LlmSettings

    text = json.dumps({"instructions": [{"style": "terse", "text": "Go on."}]})
    usage = {"prompt_tokens": 5, "completion_tokens": 7, "cost": 0.1}
    seed = {"choices": [{"message": {"role": "assistant", "content": text}}], "usage": usage}

    def read(data: bytes) -> None:
        value = json.loads(data)
        if not isinstance(value, dict):
            raise ValueError("no object")
        done = ChatCompletion.construct(**{k: v for k, v in value.items() if k[:1] != "_"})
        used = usage_of(done, LlmSettings(), [{"content": "hello"}])
        assert used.tokens_in >= 0 and used.tokens_out >= 0 and used.cost >= 0, used
        read_answer(content_of(done), Answer)

    return Target([json.dumps(seed).encode()], typed(read, ReplyError, RecursionError))


POLICIES: dict[str, Callable[[Path], Target]] = {
    "robot-toml": partial(_robot, "robot.toml"),
    "robot-mjcf": partial(_robot, "model.xml"),
    "robot-onnx": _onnx,
    "robot-card": _card,
    "policy-card": _policy_card,
    "results": _results,
    "hello": _hello,
    "reply": _reply,
}
