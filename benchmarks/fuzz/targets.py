"""What is fuzzed: one reader each, with small sound files to begin from."""

import gzip
import io
import itertools
import json
import shutil
import struct
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zstandard

from tests.support.scenes import damage
from vlnpe.formats.core.errors import InputError


@dataclass(frozen=True)
class Target:
    """A reader.

    Attributes:
        seeds: sound files.
        read: what is done with one; it may raise typed errors.
    """

    seeds: list[bytes]
    read: Callable[[bytes], object]


def _file(path: Path, read: Callable[[Path], object]) -> Callable[[bytes], object]:
    path.parent.mkdir(parents=True, exist_ok=True)

    def write_and_read(data: bytes) -> object:
        path.write_bytes(data)
        return read(path)

    return write_and_read


def _scan(suffix: str) -> Callable[[Path], Target]:
    def target(folder: Path) -> Target:
        from vlnpe.scene_repair.scan.mesh import read_mesh

        (folder / "a.png").write_bytes(damage.picture_bytes(4, 4))
        (folder / "a.mtl").write_text("newmtl a\nKd 1 0 0\nmap_Kd a.png\n")
        seeds = [d for n, d in damage.sound_files().items() if n.endswith(suffix)]
        return Target(seeds, _file(folder / f"a.{suffix}", read_mesh))

    return target


def _gltf(folder: Path) -> Target:
    from tests.security.scans.test_glb import POINTS, tree
    from vlnpe.scene_repair.scan.mesh import read_mesh

    (folder / "points.bin").write_bytes(POINTS)
    (folder / "a.png").write_bytes(damage.picture_bytes(4, 4))
    look = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    textured = tree(materials=[look], textures=[{"source": 0}], images=[{"uri": "a.png"}])
    textured["meshes"][0]["primitives"][0]["material"] = 0
    seeds = [json.dumps(value).encode() for value in (tree(), textured)]
    return Target(seeds, _file(folder / "a.gltf", read_mesh))


def _mtl(folder: Path) -> Target:
    from vlnpe.scene_repair.scan.mesh import read_mesh

    obj = folder / "a.obj"
    obj.write_text("mtllib a.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n")
    (folder / "a.png").write_bytes(damage.picture_bytes(4, 4))
    seeds = [b"newmtl a\nKd 1 0 0\nKa 0 0 0\nNs 10\nmap_Kd a.png\n"]
    return Target(seeds, _file(folder / "a.mtl", lambda _: read_mesh(obj)))


def _pcd(folder: Path) -> Target:
    from vlnpe.scene_repair.scan.headers import check_pcd

    return Target([damage.sound_files()["pcd"]], _file(folder / "a.pcd", check_pcd))


def _usd(suffix: str) -> Callable[[Path], Target]:
    def target(folder: Path) -> Target:
        from pxr import Usd

        from vlnpe.scene_repair.usd import read_stage

        plain = folder / "seed.usda"
        plain.write_bytes(damage.USDA)
        if suffix == "usdc":
            stages: Any = Usd
            stages.Stage.Open(str(plain)).Export(str(folder / "seed.usdc"))
            seed = (folder / "seed.usdc").read_bytes()
        elif suffix == "usdz":
            stream = io.BytesIO()
            with zipfile.ZipFile(stream, "w") as archive:
                archive.writestr("a.usda", damage.USDA)
            seed = stream.getvalue()
        else:
            seed = damage.USDA
        numbers = iter(range(10**9))

        def read(data: bytes) -> object:
            # USD keeps opened layers by name.
            path = folder / f"{next(numbers)}.{suffix}"
            path.write_bytes(data)
            try:
                return read_stage.read(path)
            finally:
                path.unlink()

        return Target([seed], read)

    return target


def _labels(folder: Path) -> Target:
    from tests.scene_repair.scan.test_side_files import ANCHOR
    from vlnpe.scene_repair.labels.files import read_labels

    own = {
        "frame": "source",
        "objects": [{"name": "a", "category": "bed", "lower": [0, 0, 0], "upper": [1, 1, 1]}],
    }
    seeds = [json.dumps(value).encode() for value in (own, [ANCHOR])]
    return Target(seeds, _file(folder / "a.labels.json", lambda _: read_labels(folder / "a.glb")))


def _house(folder: Path) -> Target:
    from tests.security.scans.test_house import THING, house
    from vlnpe.scene_repair.labels.matterport import read_house

    room = "R 0 0 0 0 a 0 0 0 0 0 0 2 2 2\n"
    seeds = [house(THING.format(number=0), room).encode()]
    return Target(seeds, _file(folder / "a.house", read_house))


def _vlnce(folder: Path) -> Target:
    from tests.formats.vlnce.test_vlnce import PUBLIC, RXR
    from vlnpe.formats.vlnce.files import read_vlnce, write_vlnce

    def read(path: Path) -> None:
        write_vlnce(folder / "back.json", read_vlnce(path))

    seeds = [json.dumps(value).encode() for value in (PUBLIC, RXR)]
    return Target(seeds, _file(folder / "a.json.gz", read))


def _recipe(folder: Path) -> Target:
    from vlnpe.datasets.mixture.recipe import read_recipe
    from vlnpe.datasets.mixture.shipped import SHIPPED

    seeds = [path.read_bytes() for path in SHIPPED.values()]
    seeds.append(b"recipe: 1\ntitle: t\nsources: &s {a: {robots: [h1]}}\nmixtures: {m: {a: 1.5}}\n")
    return Target(seeds, _file(folder / "a.yaml", read_recipe))


def _robot(name: str) -> Callable[[Path], Target]:
    def target(folder: Path) -> Target:
        from tests.support.robot_folders import written_rover
        from vlnpe.collectors.robots.folder.load import load_robot_folder

        rover = written_rover(folder / "rover")
        seed = (rover / name).read_bytes()
        return Target([seed], _file(rover / name, lambda _: load_robot_folder(rover)))

    return target


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
    return Target(seeds, _file(path, lambda at: load_card(at).check(robot, at)))


def _mcap(folder: Path) -> Target:
    from tests.formats.convert.test_convert import export_mcap
    from tests.support.rollouts import make_rollout
    from vlnpe.formats.convert.episodes import unit_from_mcap
    from vlnpe.formats.mcap.rollout import read_rollout, write_rollout

    write_rollout(folder / "seed.mcap", make_rollout(0.05))
    (folder / "whole").mkdir()
    whole = export_mcap(folder / "whole", make_rollout(0.0)).read_bytes()

    def read(path: Path) -> None:
        shutil.rmtree(folder / "out", ignore_errors=True)
        read_rollout(path)
        unit_from_mcap(path, folder / "out" / "unit")

    return Target([(folder / "seed.mcap").read_bytes(), whole], _file(folder / "a.mcap", read))


def _lerobot(pattern: str) -> Callable[[Path], Target]:
    def target(folder: Path) -> Target:
        from tests.formats.convert.test_convert import ASSEMBLY
        from tests.security.test_lerobot import convert, load
        from tests.support.lerobot_data import write_units
        from vlnpe.formats.core.errors import VlnpeError
        from vlnpe.formats.lerobot import assemble_dataset

        root = folder / "set"
        assemble_dataset(write_units(folder, (0.0,)), root, **ASSEMBLY)
        path = next(p for p in sorted(root.glob(pattern)) if p.is_file())
        seed = path.read_bytes()

        def read(_: Path) -> None:
            shutil.rmtree(folder / "out", ignore_errors=True)
            try:
                load(root)
            except VlnpeError:
                convert(root)
                raise
            convert(root)

        return Target([seed], _file(path, read))

    return target


def _internnav(pattern: str) -> Callable[[Path], Target]:
    def target(folder: Path) -> Target:
        from tests.formats.internnav.layouts import make_unit
        from vlnpe.formats.internnav.reader import find_scenes, read_layout_episode
        from vlnpe.formats.internnav.writer import SceneEpisode, share_instructions, write_scene
        from vlnpe.formats.lerobot import read_episode_unit
        from vlnpe.formats.vlnce.vocabulary import Vocabulary

        unit = make_unit(folder, 0, 0.5)
        tasks = share_instructions([read_episode_unit(unit)])
        scene = folder / "n1" / "r2r" / "two-rooms"
        words = Vocabulary.of(tasks[0])
        write_scene(scene, [SceneEpisode(unit, tasks[0])], words, every_frame=True)
        path = next(p for p in sorted(scene.glob(pattern)) if p.is_file())
        seed = path.read_bytes()

        def read(_: Path) -> None:
            find_scenes(folder / "n1")
            episode = read_layout_episode(scene, 0)
            for images in (episode.rgb, episode.depth):
                np.asarray(images[:1])

        return Target([seed], _file(path, read))

    return target


def _arrays(folder: Path) -> Target:
    from vlnpe.formats.untrusted.arrays import read_arrays

    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, a=np.arange(9), b=np.zeros((2, 3), np.float32))
    return Target([stream.getvalue()], _file(folder / "a.npz", read_arrays))


def _splats(suffix: str) -> Callable[[Path], Target]:
    def target(folder: Path) -> Target:
        from tests.formats.splats.test_read import gltf_bytes, spz_bytes
        from tests.support.scenes.splats import random_cloud
        from vlnpe.formats.splats.ply import write_ply_splats
        from vlnpe.formats.splats.read import read_splats

        cloud = random_cloud(np.random.default_rng(0), 4, 1)
        read = _file(folder / f"a.{suffix}", read_splats)
        if suffix == "ply":
            write_ply_splats(folder / "seed.ply", cloud)
            return Target([(folder / "seed.ply").read_bytes()], read)
        if suffix == "splat":
            row = struct.pack("<6f8B", 0, 1, 2, 0.1, 0.1, 0.1, *range(100, 108))
            return Target([4 * row], read)
        if suffix == "glb":
            return Target([gltf_bytes(cloud)], read)
        # Up to version 3 the whole file is compressed: what is inside is changed.
        plain = [gzip.decompress(spz_bytes(cloud, version)) for version in (2, 3)]

        def pack(data: bytes) -> object:
            return read(data if data[4:5] == b"\4" else gzip.compress(data, 1))

        return Target([*plain, _spz_4(plain[1], len(cloud))], pack)

    return target


def _spz_4(plain: bytes, count: int) -> bytes:
    """Return a file of version 3 and degree 1 in the layout of version 4."""
    ends = np.cumsum([16, *(n * count for n in (9, 1, 3, 3, 4, 9))])
    parts = [plain[a:b] for a, b in itertools.pairwise(ends)]
    packed = [zstandard.compress(part) for part in parts]
    head = plain[:4] + struct.pack("<I", 4) + plain[8:15] + struct.pack("<BI", len(parts), 32)
    table = [struct.pack("<QQ", len(p), len(q)) for p, q in zip(packed, parts, strict=True)]
    return b"".join([head.ljust(32, b"\0"), *table, *packed])


def _policy_card(folder: Path) -> Target:
    from vlnpe.evaluation.policy_registry import shipped_policies
    from vlnpe.learning.card import read_card

    seed = json.loads(shipped_policies()["cma"].with_suffix(".json").read_text())
    seed |= {"words": seed["words"][:4], "curves": seed["curves"][:1]}
    card = _file(folder / "a.json", lambda path: read_card(path.with_suffix(".safetensors")))
    return Target([json.dumps(seed).encode()], card)


def _results(folder: Path) -> Target:
    from tests.evaluation.test_statistics import EPISODE
    from vlnpe.evaluation.results import compare, read_results

    good = {"format": "vlnpe-results/1", "setting": {"gait_sha256": "a"}, "episodes": [EPISODE]}

    def read(path: Path) -> None:
        compare(good, read_results(path), ("good", "a"))

    return Target([json.dumps(good).encode()], _file(folder / "results.json", read))


def _hello(folder: Path) -> Target:
    from vlnpe.evaluation.server import decode, encode

    hello = {"protocol": "vlnpe-policy/1", "images": True, "version": "a", "a": np.zeros(3)}
    return Target([encode(hello)], _typed(decode))


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

    return Target([json.dumps(seed).encode()], _typed(read, ReplyError, RecursionError))


def _typed(read: Callable[[bytes], object], *others: type[Exception]) -> Callable[[bytes], object]:
    """Return `read` with the errors that its callers expect as typed ones."""

    def typed(data: bytes) -> object:
        try:
            return read(data)
        except (ValueError, *others) as error:
            raise InputError(" ".join(str(error).split())[:200]) from error

    return typed


TARGETS: dict[str, Callable[[Path], Target]] = {
    "glb": _scan("glb"),
    "gltf": _gltf,
    "obj": _scan("obj"),
    "mtl": _mtl,
    "ply": _scan("ply"),
    "stl": _scan("stl"),
    "off": _scan("off"),
    "pcd": _pcd,
    "usda": _usd("usda"),
    "usdc": _usd("usdc"),
    "usdz": _usd("usdz"),
    "labels": _labels,
    "house": _house,
    "vlnce": _vlnce,
    "recipe": _recipe,
    "robot-toml": _robot("robot.toml"),
    "robot-mjcf": _robot("model.xml"),
    "robot-onnx": _onnx,
    "robot-card": _card,
    "mcap": _mcap,
    "npz": _arrays,
    "splats-ply": _splats("ply"),
    "splats-splat": _splats("splat"),
    "splats-spz": _splats("spz"),
    "splats-glb": _splats("glb"),
    "policy-card": _policy_card,
    "results": _results,
    "hello": _hello,
    "reply": _reply,
    "lerobot-info": _lerobot("meta/info.json"),
    "lerobot-episodes": _lerobot("meta/episodes/*/*.parquet"),
    "lerobot-rows": _lerobot("data/*/*.parquet"),
    "lerobot-video": _lerobot("videos/*rgb/*/*.mp4"),
    "n1-info": _internnav("meta/info.json"),
    "n1-tasks": _internnav("meta/tasks.jsonl"),
    "n1-stats": _internnav("meta/episodes_stats.jsonl"),
    "n1-rows": _internnav("data/*/*.parquet"),
    "n1-npy": _internnav("videos/*/*depth/*.npy"),
}
