"""Scene level + robot → one compiled MuJoCo model.

Geoms are laid out for speed (measured with 1,500 boxes and a 13-body robot: 14 k steps/s with the
boxes in a body of their own, 27 k as below, 36 k with sleeping):

- Obstacle boxes hang directly on the world body: MuJoCo then walks its bounding-volume tree and
  skips the broad phase, which would visit every geom of the body in every step.
- The floor is a geom of another body; an infinite or huge geom would spoil that tree.
- Static trees are put to sleep, which saves updating their poses. The robot never sleeps.
"""

import hashlib
import logging
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import mujoco
import numpy as np

from ...formats.process.source import code_digest
from ...formats.scene import FULL_HEIGHT_M
from ...formats.scene.bundle import Obstacles, SceneBundle
from ..robots import RobotSpec, apply_physics_options
from .config import LevelModelConfig
from .floor_geom import add_floor, walked_heights
from .floor_surface import FloorSurface
from .model_cache import cached_model, model_bytes
from .obstacle_boxes import robot_obstacles
from .obstacle_gate import OBSTACLE_BIT

log = logging.getLogger(__name__)

ROBOT_PREFIX = "robot/"
# Planned above a robot's standing height: a gait lifts the body by less.
HEAD_MARGIN_M = 0.06
REACH_MARGIN_M = 0.25


def level_model(
    bundle: SceneBundle,
    level: int,
    robot: RobotSpec,
    config: LevelModelConfig | None = None,
    cache_dir: Path | None = None,
) -> mujoco.MjModel:
    """Return the compiled model of a level with a robot, from `cache_dir` if it is there.

    The cache's key covers the level's files, the robot's compiled model, the configuration, the
    code that builds it and MuJoCo's version. A damaged cache is replaced.

    Raises:
        ValueError: no such level.
        FileFormatError: the level's files are missing.
    """
    config = config or LevelModelConfig()
    if cache_dir is None:
        return build_level_model(bundle, level, robot, config)
    path = cache_dir / f"{_key(bundle, level, robot, config)}.mjb"
    return cached_model(path, lambda: build_level_model(bundle, level, robot, config))


def build_level_model(
    bundle: SceneBundle, level: int, robot: RobotSpec, config: LevelModelConfig | None = None
) -> mujoco.MjModel:
    """Compile a level with `robot` at the origin, its names under `ROBOT_PREFIX`.

    The floor is a plane at the median height when its reachable part is flat within
    `config.flat_within_m`, otherwise a height field through the heights at the cell centres, or at
    every few of them where that is as exact. The height field drops by `config.void_depth_m` more
    than `SKIRT_M` outside the covered cells, so nothing walks outside the building; over a
    plane, replay checks for the same border.

    Raises:
        ValueError: no such level.
        FileFormatError: the level's files are missing.
    """
    config = config or LevelModelConfig()
    surface = FloorSurface(bundle.floor(level))
    freemap = bundle.freemap(level).for_height(config.free_height_m)
    reach_m, height_m = robot_extent(robot)
    scene = empty_scene(f"{bundle.scene_id}-{level}-{robot.name}")
    walked = walked_heights(surface, freemap)
    kind = add_floor(scene, surface, walked, config)
    top_m = float(walked.max(initial=bundle.level_floor_z_m[level])) + height_m
    boxes = robot_obstacles(bundle.obstacles(level), freemap, reach_m, top_m + config.headroom_m)
    add_boxes(scene, boxes, config)
    add_robot(scene, robot)
    model = scene.compile()
    log.debug(
        "level %d of %s for %s: floor %s, %d of %d boxes",
        level,
        bundle.scene_id,
        robot.name,
        kind,
        len(boxes.center_m),
        len(bundle.obstacles(level).center_m),
    )
    return model


def empty_scene(name: str) -> mujoco.MjSpec:
    """Return a scene with the options of all models."""
    scene = mujoco.MjSpec()
    scene.modelname = name
    apply_physics_options(scene)
    scene.option.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
    # Diverged physics must be noticed and end the episode, not silently reset.
    scene.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return scene


def add_robot(scene: mujoco.MjSpec, robot: RobotSpec) -> None:
    """Add a robot at the origin, its names under `ROBOT_PREFIX`."""
    body = _robot_that_meets_obstacles(robot)
    scene.worldbody.add_frame().attach_body(body, ROBOT_PREFIX, "")
    scene.body(ROBOT_PREFIX + robot.root_body).sleep = mujoco.mjtSleepPolicy.mjSLEEP_NEVER


def free_height(robot: RobotSpec) -> float:
    """Return the free height [m] that a robot needs, at most `FULL_HEIGHT_M`."""
    _, height_m = robot_extent(robot)
    return min(round(height_m + HEAD_MARGIN_M, 2), FULL_HEIGHT_M)


def add_boxes(scene: mujoco.MjSpec, boxes: Obstacles, config: LevelModelConfig) -> None:
    """Add collision boxes to the world body, where physics finds them fastest."""
    for k, (center, half) in enumerate(zip(boxes.center_m, boxes.half_m, strict=True)):
        scene.worldbody.add_geom(
            name=f"obstacle_{k}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=center,
            size=half,
            friction=[config.friction, 0.02, 0.01],
            contype=OBSTACLE_BIT,
            conaffinity=0,
        )


def _robot_that_meets_obstacles(robot: RobotSpec) -> mujoco.MjsBody:
    spec = robot.spec()
    for geom in list(spec.geoms):
        if geom.contype or geom.conaffinity:
            # On one side only: parts that could not collide before must not start to.
            geom.conaffinity |= OBSTACLE_BIT
        elif geom.mass == 0.0 and not geom.name:
            # What is only seen cannot change physics, yet costs up to a sixth of its time.
            spec.delete(geom)
    return spec.body(robot.root_body)


def robot_extent(robot: RobotSpec) -> tuple[float, float]:
    """Return the reach of any part from the base axis and the standing height [m]."""
    model = robot.build_model(floor=False)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    solid = np.flatnonzero((model.geom_contype | model.geom_conaffinity) > 0)
    rotation = data.geom_xmat[solid].reshape(-1, 3, 3)
    local = model.geom_aabb[solid]
    center = data.geom_xpos[solid] + np.einsum("gij,gj->gi", rotation, local[:, :3])
    half = np.einsum("gij,gj->gi", np.abs(rotation), local[:, 3:])
    lower, upper = center - half, center + half
    base = data.xpos[model.body(robot.root_body).id]
    out = np.linalg.norm(np.maximum(upper - base, base - lower)[:, :2], axis=1).max()
    # Joints swing limbs about: a leg kicked out reaches no farther than it hangs down.
    reach = max(float(out), float(base[2] - lower[:, 2].min())) + REACH_MARGIN_M
    return reach, float(upper[:, 2].max() - lower[:, 2].min())


def _key(bundle: SceneBundle, level: int, robot: RobotSpec, config: LevelModelConfig) -> str:
    facts = (bundle.scene_id, level, bundle.level_floor_z_m[level])
    return model_key(__name__, [bundle.level_folder(level)], facts, robot, config)


def model_key(
    module: str,
    sheets: Sequence[Path],
    facts: Sequence[object],
    robot: RobotSpec,
    config: LevelModelConfig,
) -> str:
    """Return the cache's key of a model that a module builds from the files of some sheets."""
    digest = hashlib.sha256()
    digest.update(code_digest(module).encode())
    names = ("floor.npz", "obstacles.npz", "freemap.npz", "treads.npz")
    for path in (sheet / name for sheet in sheets for name in names):
        # The builder reports a missing file.
        digest.update(path.read_bytes() if path.is_file() else b"")
    digest.update(model_bytes(robot.build_model(floor=False)))
    facts = (*facts, robot.name, robot.root_body, asdict(config), mujoco.__version__)
    digest.update(repr(facts).encode())
    return digest.hexdigest()[:32]
