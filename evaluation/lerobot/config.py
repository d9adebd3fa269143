"""Options of `lerobot-eval --env.type=vlnpe`; LeRobot learns the type when this is imported."""

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import gymnasium as gym
from gymnasium.vector import AutoresetMode
from lerobot.configs import FeatureType, PolicyFeature
from lerobot.envs.configs import EnvConfig, HubEnvConfig
from lerobot.envs.utils import freeze_after_episode_end

from ...collectors.controllers import controller_for
from ...collectors.robots import get_robot
from ...formats.core.errors import InputError
from ...formats.lerobot.layout import RGB_KEY
from ...formats.vlnce.files import read_episodes
from ...rendering.camera.views import CameraOverrides, View, parse_views
from ...rendering.registry import AUTO
from .env import FPS, STATE_SIZE, LeRobotEnv

STATE_KEY = "observation.state"


@EnvConfig.register_subclass("vlnpe")
@dataclass
class VlnpeEnv(HubEnvConfig):
    """Episodes and a robot in our closed loop.

    With `hub_path` of the base class, the environment that `vlnpe push --env` published there runs
    instead, and the other options do not matter.

    Attributes:
        episodes: Episode file, e.g. runs/<name>/episodes/val_unseen.json.gz.
        scenes: Folder of the repaired scenes, e.g. runs/<name>/scenes.
        robot: Name, or folder of one's own robot.
        camera: Camera of the training data, ego or a rig, with size and HFOV: ego:256x256:90.
        light: Lighting of the training data.
        renderer: embree, gl, splat, splat_depth, or auto.
    """

    task: str | None = "vlnpe"
    fps: int = FPS
    episodes: Path | None = None
    scenes: Path | None = None
    robot: str = "aliengo"
    camera: str = "ego"
    light: str = "baked"
    renderer: str = AUTO
    features_map: dict[str, str] = field(
        default_factory=lambda: {"action": "action", RGB_KEY: RGB_KEY, "agent_pos": STATE_KEY}
    )

    def __post_init__(self) -> None:
        """Describe observations and actions.

        Raises:
            InputError: If the frame rate, the robot or the camera is not valid.
        """
        if self.fps != FPS:
            raise InputError(f"--env.fps {self.fps}; valid: {FPS}, because actions last 0.25 s")
        camera = self._view().camera
        rgb = (camera.height_px, camera.width_px, 3)
        self.features = {
            "action": PolicyFeature(FeatureType.ACTION, (3,)),
            RGB_KEY: PolicyFeature(FeatureType.VISUAL, rgb),
            "agent_pos": PolicyFeature(FeatureType.STATE, (STATE_SIZE,)),
        }

    def create_envs(
        self, n_envs: int, use_async_envs: bool = False
    ) -> dict[str, dict[int, gym.vector.VectorEnv]]:
        """Return {"vlnpe": {0: environments}}; those that end before the others wait for them.

        Raises:
            InputError: If episodes or scenes are not given or missing.
            FileFormatError: If the episodes cannot be read.
        """
        if self.episodes is None or self.scenes is None:
            raise InputError(
                "--env.episodes and --env.scenes are missing; valid: an episode file and the "
                "folder of its repaired scenes, or --env.hub_path USER/NAME"
            )
        episodes = read_episodes(self.episodes)
        make = partial(LeRobotEnv, episodes, self.scenes, self.robot, self._view(), self.renderer)
        makers = [freeze_after_episode_end(make) for _ in range(n_envs)]
        mode = AutoresetMode.SAME_STEP
        if use_async_envs and n_envs > 1:
            vector = gym.vector.AsyncVectorEnv(makers, context="forkserver", autoreset_mode=mode)
        else:
            vector = gym.vector.SyncVectorEnv(makers, autoreset_mode=mode)
        return {"vlnpe": {0: vector}}

    def _view(self) -> View:
        robot = get_robot(self.robot)
        controller_for(robot, "speed")
        views = parse_views(
            self.camera, robot, CameraOverrides(), light=self.light, renderer="embree"
        )
        if len(views) != 1 or views[0].kind != "ego":
            raise InputError(f"--env.camera {self.camera}; valid: ego or a rig, with size and HFOV")
        return views[0]
