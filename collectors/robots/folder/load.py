"""A user's own robot: a folder of facts, model and policy; see docs/reference/robots.md.

- robot.toml: facts.
- model.xml: MJCF, with its meshes beside it.
- policy.safetensors or policy.onnx, and policy.json: the trained gait of a robot that walks, and
  its card.
"""

import hashlib
from functools import partial
from pathlib import Path

import mujoco

from ....formats.core.atomic import file_digest
from ....formats.core.errors import FileFormatError
from ..parts import Foot
from ..spec import RobotSpec
from .facts import FACTS_NAME, FolderFacts, read_facts
from .model import MODEL_NAME, compile_model, load_model
from .reader import ModelReader
from .safety import check_model, folder_files

NETWORK_NAMES, CARD_NAME = ("policy.safetensors", "policy.onnx"), "policy.json"
SPAWN_GAP_M = 0.001
ACTION_SCALE_RAD = 0.5


def load_robot_folder(folder: Path) -> RobotSpec:
    """Read a robot's folder and check all of it but the policy, which is checked when loaded.

    Raises:
        FileFormatError: a file or field is missing or invalid; the message names it and what is
            valid.
    """
    folder = folder.resolve()
    folder_files(folder)
    facts = read_facts(folder / FACTS_NAME)
    build = partial(_build, folder=folder, feet=facts.feet)
    if (folder / MODEL_NAME).is_file():
        check_model(folder / MODEL_NAME)
    spec = load_model(folder, facts.feet)
    root = spec.worldbody.bodies[0]
    model = compile_model(folder, spec)
    reader = ModelReader(folder, model, facts)
    reader.check_feet()
    joints = reader.joints()
    _check_mover(folder, facts)
    stands_m = reader.standing_m(root.name)
    walks = facts.drive is None and bool(joints)
    policy_joints = (facts.policy_joints or len(joints)) if walks else 0
    if policy_joints > len(joints):
        raise FileFormatError(
            folder / FACTS_NAME, f"policy_joints is {policy_joints}; valid: 1 … {len(joints)}"
        )
    return RobotSpec(
        name=facts.name,
        title=facts.title,
        mass_kg=round(float(model.body_subtreemass[0]), 9),
        joints=joints,
        policy_joints=policy_joints,
        action_scale_rad=(facts.action_scale_rad or ACTION_SCALE_RAD) if walks else 0.0,
        root_body=root.name,
        root_joint=root.joints[0].name,
        feet=facts.feet,
        base_height_m=facts.base_height_m or stands_m,
        spawn_height_m=facts.spawn_height_m or stands_m + SPAWN_GAP_M,
        footprint_radius_m=facts.footprint_radius_m,
        camera=reader.camera(),
        fall=facts.fall,
        command_limits=facts.command_limits,
        sources=facts.sources,
        build=build,
        drive=facts.drive,
        rhythm=facts.rhythm,
        folder=folder,
        content_sha256=folder_digest(folder),
    )


def _build(robot: RobotSpec, folder: Path, feet: tuple[Foot, ...]) -> mujoco.MjSpec:
    spec = load_model(folder, feet)
    spec.modelname = robot.name
    return spec


def _check_mover(folder: Path, facts: FolderFacts) -> None:
    """Check that a robot with joints has wheels or legs, and can move forward.

    A robot that walks need not have a gait yet.

    Raises:
        FileFormatError: it has both wheels and a gait, or half a gait.
    """
    path = folder / FACTS_NAME
    policy = [name for name in (*NETWORK_NAMES, CARD_NAME) if (folder / name).is_file()]
    if facts.drive is not None and (policy or facts.rhythm):
        other = policy[0] if policy else "[gait]"
        raise FileFormatError(path, f"has [drive] and {other}; valid: one of them")
    if facts.drive is None and policy and (len(policy) != 2 or CARD_NAME not in policy):
        raise FileFormatError(
            folder,
            f"{' and '.join(policy)} to drive this robot's joints; valid: "
            f"{' or '.join(NETWORK_NAMES)}, and {CARD_NAME}",
        )
    if facts.rhythm is not None and len(facts.rhythm.foot_offsets) != len(facts.feet):
        raise FileFormatError(
            path,
            f"gait.foot_offsets has {len(facts.rhythm.foot_offsets)} phases; valid: one for each "
            f"of the {len(facts.feet)} feet",
        )
    if facts.joints and facts.command_limits.vx_m_s[1] <= 0:
        raise FileFormatError(path, "command_limits.vx_m_s must reach above 0; valid: [-0.3, 1.0]")


def folder_digest(folder: Path) -> str:
    """Return the SHA-256 hex over the names and contents of a robot's files."""
    state = hashlib.sha256()
    for path in folder_files(folder):
        content = file_digest(path)
        state.update(f"{path.relative_to(folder).as_posix()}={content};".encode())
    return state.hexdigest()
