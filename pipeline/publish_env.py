"""The environment of a run as LeRobot loads it from the hub: `env.py`, episodes, scenes."""

import shutil
from pathlib import Path

from ..formats.core.atomic import TEMPORARY_PREFIX
from ..formats.core.errors import InputError
from ..formats.core.licences import hub_licence, licence_id
from ..formats.lerobot.info import read_info
from ..formats.lerobot.layout import PROVENANCE_PATH
from ..formats.scene.bundle import load_bundle
from ..formats.untrusted.documents import read_json_object
from ..formats.vlnce.files import write_episodes
from ..rendering.camera.views import camera_and_light
from .inputs.episode_file import episodes_of
from .inputs.robot_copies import FOLDER
from .publish import CARD, ENV, Release, released

EPISODES = "episodes.json.gz"
ENV_PY = '''"""Vision-and-language navigation in physics, for LeRobot; vlnpe must be installed."""

from pathlib import Path

from huggingface_hub import snapshot_download
from vlnpe.evaluation.lerobot.config import VlnpeEnv

HERE = Path(__file__).parent


def make_env(n_envs=1, use_async_envs=False, cfg=None):
    """Return {{"vlnpe": {{0: environments}}}}; what `cfg` says of episodes and robot is ignored."""
    # LeRobot downloads this file alone, into a folder that is named after the commit.
    whole = (HERE / "{episodes}").is_file()
    folder = HERE if whole else Path(snapshot_download("{repo}", revision=HERE.name))
    env = VlnpeEnv(
        episodes=folder / "{episodes}",
        scenes=folder / "scenes",
        robot={robot},
        camera="{camera}",
        light="{light}",
    )
    return env.create_envs(n_envs, use_async_envs)
'''
README = """---
{licence}
library_name: lerobot
tags: [robotics, vision-and-language-navigation, vlnpe]
---
# {title}

{count} episodes (`{split}`) in {scenes} scenes for the robot {robot} with its camera `{camera}`.

```sh
lerobot-eval --policy.path=POLICY --env.discover_packages_path=vlnpe.evaluation.lerobot \\
  --env.type=vlnpe --env.hub_path={repo} --trust_remote_code=true --eval.n_episodes={count}
```
"""


def plan_env(
    folder: Path, dataset: Path, split: str, repo: str, tag: str | None, private: bool
) -> Release:
    """Write the environment of a dataset's run into a folder, and plan its release.

    Scenes are linked, so the folder is not to be kept.

    Args:
        folder: An empty folder.
        dataset: A LeRobot dataset within its run; its robot, camera and light are the
            environment's.
        split: Whose episodes to take.
        repo, tag, private: See `plan_release`.

    Raises:
        InputError: If the dataset is not in a run, the split does not exist, a name is not taken by
            the hub, or the images are neither those of the robot's own camera nor of a rig.
        FileFormatError: If the dataset or a scene is damaged.
    """
    robot = str(read_info(dataset)["robot_type"])
    shown = read_json_object(dataset / PROVENANCE_PATH).get("encoding", {}).get("view")
    camera, light = camera_and_light(str(shown))
    if not camera.startswith(("ego:", "rig:")):
        raise InputError(
            f"{dataset.name} shows {shown}; valid for --env: a dataset of the robot's own camera "
            "(ego) or of a rig"
        )
    run = dataset.resolve().parents[1]
    episodes, scenes_folder = episodes_of(run, None, split)
    write_episodes(folder / EPISODES, episodes)
    sources = {}
    for name in sorted({episode.scene_id for episode in episodes}):
        sources[name] = load_bundle(scenes_folder / name).source
        _link(scenes_folder / name, folder / "scenes" / name)
    own = run / FOLDER / robot
    if own.is_dir():
        _link(own, folder / FOLDER / robot)
    licence = hub_licence(licence_id(str(s.get("licence") or "")) for s in sources.values())
    if "license_link" in licence:
        licence["license_link"] = "scenes"
    facts = {
        "repo": repo,
        "episodes": EPISODES,
        "robot": f'str(folder / "{FOLDER}" / "{robot}")' if own.is_dir() else f'"{robot}"',
        "camera": camera,
        "light": light,
    }
    (folder / "env.py").write_text(ENV_PY.format(**facts))
    card = {
        "licence": "\n".join(f'{key}: "{value}"' for key, value in licence.items()),
        "title": f"{run.name}: {split}",
        "count": len(episodes),
        "scenes": len(sources),
        "split": split,
    }
    (folder / CARD).write_text(README.format(**{**facts, "robot": robot, **card}))
    return released(folder, repo, tag, private, scenes=sources, kind=ENV)


def _link(source: Path, target: Path) -> None:
    """Copy a folder as links to its finished files."""

    def unfinished(_: str, names: list[str]) -> list[str]:
        return [name for name in names if name.startswith(TEMPORARY_PREFIX[0])]

    def link(file: str, copy: str) -> None:
        Path(copy).symlink_to(file)

    shutil.copytree(source.resolve(), target, ignore=unfinished, copy_function=link)
