"""Episodes drawn and written by the obvious script, against the stages render and export.

The script is what one writes first: one process, `mujoco.Renderer` with its defaults on the scene's
textured triangles and the robot, colour and depth drawn one after the other, every frame handed to
`LeRobotDataset.add_frame`, and the default codecs of `save_episode`. Both get the same recorded
walks: neither simulates. Neither is charged with loading: each has drawn before it is timed.

python -m benchmarks.writing.obvious RUN    # the script's side alone, as JSON
"""

import json
import logging
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from benchmarks.writing.write import add_episode, assemble, features
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.frames import OPTICAL_TO_OPENGL, matrix_to_quat, quat_to_matrix
from vlnpe.formats.core.rollout import Rollout
from vlnpe.formats.core.threads import available_cores
from vlnpe.formats.mcap.rollout import read_rollout
from vlnpe.formats.rendered.folder import FrameFolder, read_frame_folder
from vlnpe.formats.rendered.table import build_frame_table
from vlnpe.formats.scene.bundle import SceneBundle, load_bundle
from vlnpe.pipeline.engine.executors.attempts import attempt_chain
from vlnpe.pipeline.engine.executors.processes import Workers
from vlnpe.pipeline.engine.ledger import Ledger
from vlnpe.pipeline.stages.datasets.export_job import UnitJob
from vlnpe.pipeline.stages.rollouts.render_job import RenderJob
from vlnpe.rendering.camera.extras import Extras
from vlnpe.rendering.camera.views import VIEWS, View
from vlnpe.rendering.gl.probe import graphics_card, why_no_gl

ROOT = Path(__file__).resolve().parents[2]
REPEATS = 2  # each episode is made so often by us, so that the workers' ends weigh less
COSTS = ("wall", "cpu")


def report(run: Path) -> str:
    """Make the rendered episodes of a run again in both ways; return a Markdown section."""
    title = "## Against the obvious script"
    reason = why_no_gl()
    if reason:
        return f"{title}\n\nLeft out: OpenGL cannot draw here ({reason})."
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.writing.obvious", str(run)],
        cwd=ROOT,
        env={**os.environ, "MUJOCO_GL": "egl", "PYOPENGL_PLATFORM": "egl"},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    script = json.loads(done.stdout.splitlines()[-1])
    ours = _ours(run)
    scene, folders = _episodes(run)
    frames = sum(folder.facts["frames"] for folder, _ in folders)
    device = graphics_card() or "Mesa's llvmpipe, on the processor"
    rows = [
        f"| {name} | {_hourly(costs, 'wall')} | {_hourly(costs, 'cpu')} |"
        for name, costs in (("the script", script), ("**vlnpe**", ours))
    ]
    ratio = " | ".join(f"{script[kind] / ours[kind]:.1f}" for kind in COSTS)
    return "\n".join(
        [
            title,
            "",
            f"{len(folders)} recorded walks in {scene.name}, {frames} frames of RGB and depth, to",
            f"a LeRobot dataset. The script: `mujoco.Renderer` ({device}), `add_frame` and",
            "`save_episode`, all with their defaults, in one process; vlnpe: the jobs of `render`",
            f"and `export` in {available_cores()} workers. No physics on either side.",
            "",
            f"| way | episodes/h on {available_cores()} cores | episodes per hour of CPU time |",
            "| --- | ---: | ---: |",
            *rows,
            f"| ratio | {ratio} |",
            "",
        ]
    )


def _hourly(costs: dict[str, float], kind: str) -> str:
    return f"{3600 / costs[kind]:,.0f}"


def _episodes(run: Path) -> tuple[Path, list[tuple[FrameFolder, Path]]]:
    """Return the scene's folder, and the frames and the rollout of each rendered episode."""
    rows = [row for row in Ledger.existing(run).rows("render") if row.status == "done"]
    scene = next(path for path in (run / "scenes").iterdir() if path.is_dir())
    return scene, [
        (read_frame_folder(run / row.outputs[0]), run / str(row.facts["rollout"])) for row in rows
    ]


def _ours(run: Path) -> dict[str, float]:
    """Return seconds per episode of the stages' jobs, on all cores and of CPU time."""
    scene, episodes = _episodes(run)
    with tempfile.TemporaryDirectory() as temporary, Workers(available_cores()) as workers:

        def make(name: str, times: int) -> list[Any]:
            futures = []
            for number, (seen, rollout) in enumerate(episodes * times):
                out = Path(temporary) / name / str(number)
                jobs = _jobs(scene, seen, rollout, out)
                steps = [(job, (job.out,), True, False) for job in jobs]
                futures.append(workers.submit(attempt_chain, steps, 1))
            return [outcome for future in futures for outcome in future.result()]

        make("warm", 2)
        started, cpu = time.perf_counter(), time.process_time()
        outcomes = make("timed", REPEATS)
        count = len(episodes) * REPEATS
        units = [Path(temporary) / "timed" / str(k) / "unit" for k in range(count)]
        assemble(units, Path(temporary) / "dataset")
        wall, cpu = time.perf_counter() - started, time.process_time() - cpu
    for outcome in outcomes:
        if outcome.error:
            raise outcome.error
    return {"wall": wall / count, "cpu": (cpu + sum(o.cpu_seconds for o in outcomes)) / count}


def _jobs(scene: Path, seen: FrameFolder, rollout: Path, out: Path) -> tuple[RenderJob, UnitJob]:
    robot = get_robot(str(seen.facts["robot"]))
    view = View("ego", VIEWS["ego"].default_camera(robot))
    rate, frames = seen.frames_per_second, out / "frames"
    return (
        RenderJob(scene, rollout, "r.mcap", robot, view, rate, "h264", Extras(), frames),
        UnitJob(rollout, frames, out / "unit", "video", out / "review.jsonl"),
    )


def _script(run: Path) -> dict[str, float]:
    """Return seconds per episode of the obvious script, of the clock and of CPU time."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    logging.getLogger("lerobot").setLevel(logging.ERROR)
    scene, folders = _episodes(run)
    episodes = [(seen, read_rollout(path)) for seen, path in folders]
    camera = episodes[0][0].camera
    stage = Stage(load_bundle(scene), episodes[0][1], camera.focal_px, camera.height_px)
    tables = [build_frame_table(r, seen.arrays, seen.frames_per_second) for seen, r in episodes]
    size = (camera.height_px, camera.width_px)
    with (
        tempfile.TemporaryDirectory() as temporary,
        mujoco.Renderer(stage.model, *size) as renderer,
    ):
        next(stage.pictures(renderer, *episodes[0]))
        started, cpu = time.perf_counter(), _cpu_seconds()
        dataset = LeRobotDataset.create(
            "vlnpe/obvious",
            episodes[0][0].frames_per_second,
            features(tables[0], size),
            root=Path(temporary) / "dataset",
            robot_type=episodes[0][1].robot,
        )
        for (seen, rollout), table in zip(episodes, tables, strict=True):
            add_episode(dataset, rollout, table, stage.pictures(renderer, seen, rollout))
        dataset.finalize()
        wall, cpu = time.perf_counter() - started, _cpu_seconds() - cpu
    return {"wall": wall / len(episodes), "cpu": cpu / len(episodes)}


def _cpu_seconds() -> float:
    """Return the CPU time of this process and of those it has waited for [s]."""
    used = [resource.getrusage(k) for k in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in used)


class Stage:
    """A robot amid the triangles of a scene, with a camera that is put where it was.

    Attributes:
        model: one mesh per material, and the robot.
    """

    def __init__(self, bundle: SceneBundle, rollout: Rollout, focal_px: float, height_px: int):
        """Compile the model; the camera has the given focal length and image height [px]."""
        spec = get_robot(rollout.robot).spec()
        _add_scene(spec, bundle)
        eye = spec.worldbody.add_body(name="eye", mocap=True)
        fovy = 2 * np.rad2deg(np.arctan(0.5 * height_px / focal_px))
        eye.add_camera(name="eye", fovy=fovy)
        self.model = spec.compile()
        self._data = mujoco.MjData(self.model)
        joints = self.model.jnt_type
        self._base = int(self.model.jnt_qposadr[joints == mujoco.mjtJoint.mjJNT_FREE][0])
        names = rollout.joint_names
        self._joints = np.array([self.model.joint(name).qposadr[0] for name in names])

    def pictures(
        self, renderer: mujoco.Renderer, seen: FrameFolder, rollout: Rollout
    ) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.float32]]]:
        """Yield colour (H, W, 3) and depth (H, W) [m] of each frame of an episode."""
        data, arrays = self._data, seen.arrays
        poses = zip(
            arrays["sample_index"],
            arrays["camera_position_world_m"],
            arrays["camera_quat_wxyz"],
            strict=True,
        )
        for sample, position, quat in poses:
            data.qpos[self._base : self._base + 3] = rollout.position_world_m[sample]
            data.qpos[self._base + 3 : self._base + 7] = rollout.quat_wxyz[sample]
            data.qpos[self._joints] = rollout.joint_position_rad[sample]
            data.mocap_pos[0] = position
            data.mocap_quat[0] = matrix_to_quat(quat_to_matrix(quat) @ OPTICAL_TO_OPENGL)
            mujoco.mj_forward(self.model, data)
            renderer.update_scene(data, camera="eye")
            rgb = renderer.render()
            renderer.enable_depth_rendering()
            depth = renderer.render()
            renderer.disable_depth_rendering()
            yield rgb, depth


def _add_scene(spec: mujoco.MjSpec, bundle: SceneBundle) -> None:
    """Add one mesh and one texture per material to the world, to be seen only."""
    visual = bundle.visual()
    for index, material in enumerate(bundle.materials):
        faces = visual.face_material == index
        if not faces.any():
            continue
        name = f"scene{index}"
        look = spec.add_material(name=name, rgba=[*material.base_color, 1.0])
        if material.texture is not None:
            pixels = np.asarray(Image.open(bundle.root / material.texture).convert("RGB"))
            texture = spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D)
            texture.height, texture.width, texture.nchannel = pixels.shape
            texture.data = pixels.tobytes()
            look.textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = name
        corners = visual.vertices[visual.faces[faces]].reshape(-1, 3)
        uv = visual.corner_uv[faces].reshape(-1, 2)
        mesh = spec.add_mesh(name=name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
        mesh.uservert = corners.ravel()
        mesh.userface = mesh.userfacetexcoord = np.arange(len(corners), dtype=np.int32)
        # MuJoCo's v points down.
        mesh.usertexcoord = np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1).astype(np.float32).ravel()
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            material=name,
            contype=0,
            conaffinity=0,
        )


if __name__ == "__main__":
    sys.stdout.write(json.dumps(_script(Path(sys.argv[1]))) + "\n")
