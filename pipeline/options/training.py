"""Options of the commands for training data: `mix`, `train`, `ablate`."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from ...datasets.mixture.shipped import SHIPPED
from ...formats.core.errors import InputError, check_name
from ...trajectory_sampler.config import SampleConfig
from . import check_numbers
from .shared import Orientation, Parallel, Printing

RECIPE = tyro.conf.arg(
    metavar="RECIPE",
    help=f"Recipe file (.yaml), or the name of a built-in recipe: {', '.join(SHIPPED)}.",
)


@dataclass(frozen=True)
class Mix(Printing):
    """Show the training data of a recipe's mixtures: datasets, episodes, shares and exclusions.

    Unless --dry-run is given, the selected episodes are also written to --out, by dataset and
    episode index.
    """

    recipe: Annotated[tyro.conf.Positional[str], RECIPE]
    data: Path = Path("runs")
    """Folder of the runs that contain the datasets."""
    mixture: str | None = None
    """Show only this mixture of the recipe."""
    draws: str = "episodes"
    """Unit that is sampled and that shares are computed from: episodes or frames."""
    dry_run: bool = False
    """Show the mixtures without writing anything."""
    out: Path | None = None
    """Output file for the selected episodes (.json)."""


@dataclass(frozen=True)
class Train(Printing):
    r"""Train a policy (Seq2Seq, CMA or RDP) on collected datasets.

    Writes <out>/<model>.safetensors with its card <model>.json, and curves.csv. Run the same
    command again to resume after an interruption. The recipe names the data and holds all settings
    under `train` (docs/guides/training.md); `vlnpe mix` shows the selected data.

    Example: collect, train, evaluate:
      vlnpe collect --robot vlnce --scene 'builtin-exact:apartment*14' --train-scenes 10 \
        --splits train=320,val_unseen=64 --allow-fewer --camera ego:64x64 --no-mcap \
        --out runs/homes
      vlnpe train starter --data runs/homes --out runs/starter
      vlnpe evaluate runs/homes --split val_unseen --policy runs/starter/cma.safetensors \
        --robot vlnce
    """

    recipe: Annotated[tyro.conf.Positional[str], RECIPE]
    data: Path = Path("runs")
    """Folder of the runs that contain the datasets."""
    mixture: str | None = None
    """Mixture of the recipe to train on; only needed where it has several."""
    out: Path = Path("runs/train")
    """Output folder for the checkpoint, curves, resumable state and decoded images."""
    cache: Path | None = None
    """Folder of decoded images, which several training runs can share; defaults to <out>/cache."""
    model: str | None = None
    """Model: cma, seq2seq or rdp; overrides the recipe."""
    inputs: str | None = None
    """Inputs of the model, comma-separated: rgb,depth,instruction; overrides the recipe."""
    steps: int | None = None
    """Training steps; overrides the recipe."""
    seed: int | None = None
    """Random seed; overrides the recipe."""
    start: Path | None = None
    """Checkpoint (.safetensors) to start from (fine-tuning); its vocabulary is kept."""
    run: Path | None = None
    """Run folder with the scenes and episodes of --validate, --augment and --dagger."""
    validate: int = 0
    """Number of episodes of --run to evaluate in closed loop at each checkpoint, always the same
    ones; the checkpoint with the highest success rate is kept. 0 keeps the last one."""
    validate_split: str | None = None
    """Split of these episodes, for example val_seen; all by default."""
    augment: int = 0
    """Number of additional paths to train on (as in EnvDrop): sampled in the training scenes, away
    from held-out paths, described by the composer and walked by the expert, in <out>/augmented."""
    dagger: int = 0
    """Rounds of `vlnpe dagger` after training: the model walks training episodes of --run, the
    expert labels each pose, and training continues on both, in <out>/dagger-<round>."""
    dagger_episodes: int = 50
    """Number of episodes per round of DAgger."""
    robot: str = "vlnce"
    """Robot of --validate, --augment and --dagger: a name (see `vlnpe robots`), or the folder of
    your own."""
    controller: str = "flash"
    """Controller of --validate, --augment and --dagger: flash (placed without physics), or
    speed."""
    device: str | None = None
    """Torch device: cpu, cuda or auto; overrides the recipe."""
    threads: int = 0
    """Number of torch threads, and of processes that walk for --augment and --dagger; 0 uses one
    per core."""

    def check(self) -> None:
        """Raise InputError if a number is negative, or the run that is walked is not named."""
        check_numbers(self, 0, "validate", "augment", "dagger", "dagger_episodes", "threads")
        if (self.validate or self.augment or self.dagger) and self.run is None:
            raise InputError(
                "--validate, --augment and --dagger need the scenes and episodes of a run; name it "
                "with --run FOLDER"
            )

    def changes(self, train: Mapping[str, Any]) -> dict[str, Any]:
        """Return the settings that these options override in a recipe's `train`.

        Raises:
            InputError: its model is no mapping.
        """
        changes = {
            name: value
            for name in ("steps", "device")
            if (value := getattr(self, name)) is not None
        }
        model = train.get("model") or {}
        if not isinstance(model, dict):
            raise InputError(f"train: model: {model!r}; valid: a mapping")
        model = dict(model)
        if self.model is not None:
            model["name"] = self.model
        if self.inputs is not None:
            model["inputs"] = [name.strip() for name in self.inputs.split(",") if name.strip()]
        return changes | {"model": model}


@dataclass(frozen=True)
class Ablate(Parallel):
    r"""Compare training data: train a policy on each mixture of a recipe and let it walk.

    Every row of the recipe's `comparison` is trained with several seeds; then each policy walks the
    same held-out episodes in closed loop, as in `vlnpe evaluate`. Writes results.json, report.md
    and report.html: success rates, and for each claim the difference with its 95 % interval over
    seeds and scenes, whether it is shown, and how much more would show a smaller one. Run the same
    command again to resume after an interruption; what is finished is not done again.

    Example: does adding the quadruped's data help the humanoid? (under an hour on two cores)
      vlnpe collect --robot h1,aliengo --controller speed --scene 'builtin-exact:apartment*14' \
        --train-scenes 10 --splits train=160,val_unseen=48 --allow-fewer --camera ego:64x64 \
        --no-mcap --out runs/both
      vlnpe ablate quadruped_for_humanoid --data runs/both
    """

    recipe: Annotated[tyro.conf.Positional[str], RECIPE]
    data: Path = Path("runs")
    """Folder of the runs that contain the datasets."""
    run: Path | None = None
    """Run folder with the scenes and episodes to walk; defaults to the only run in --data. Only
    episodes are walked that no row is trained on."""
    split: str | None = None
    """Walk only held-out episodes of this split, for example val_unseen."""
    out: Path = Path("runs/ablation")
    """Output folder for results, checkpoints, walks and decoded images."""
    trainings: Path | None = None
    """Output folder of another ablation of the recipe, whose checkpoints are used and completed: to
    test the same trainings in another --run. Defaults to --out."""
    rows: str = ""
    """Rows to measure, separated by semicolons; all by default. Rows whose data is missing are left
    out with a warning."""
    walks: int | None = None
    """Maximum number of episodes that each policy walks; overrides the recipe."""
    steps: int | None = None
    """Training steps; overrides the recipe. Rows with steps of their own keep their ratio."""
    seeds: int | None = None
    """Number of trainings per row; overrides the recipe."""
    device: str | None = None
    """Torch device: cpu, cuda or auto; overrides the recipe."""
    threads: int = 0
    """Number of torch threads in training; 0 uses one per core."""

    def check(self) -> None:
        """Raise InputError if a number is too small."""
        check_numbers(self, 1, "seeds", "steps", "walks")
        check_numbers(self, 0, "threads")

    @property
    def chosen_rows(self) -> list[str]:
        """Names of the rows to measure; none for all."""
        return [name.strip() for name in self.rows.split(";") if name.strip()]


@dataclass(frozen=True)
class Adapt(Orientation, Parallel):
    r"""Fine-tune a policy to your own building and robot, and test it before and after.

    Repairs the scan, samples paths in it, and sets those aside that end in some of the rooms, a
    third to half of them. The expert walks the others with the robot, and the policy is fine-tuned
    on its walks. Before and after, the policy walks the paths that were set aside. Writes
    report.html, and the checkpoint with its card; prints the command that serves it to a robot. The
    same command again resumes; what is finished and unchanged is not done again.

    Example: vlnpe adapt scan.glb --robot aliengo
    """

    scene: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="SCENE")]
    """Scan of the building, or a generated one (builtin, builtin:villa), as --scene of `vlnpe
    collect`."""
    robot: str = "aliengo"
    """Robot: a name (see `vlnpe robots`), or the folder of your own."""
    controller: str = "auto"
    """Controller: speed (physics), flash (placed without physics), or auto: the first of these that
    suits the robot."""
    policy: str = "cma-robots-32px"
    """Policy to start from: one that comes with vlnpe (cma-robots-32px; cma-robots, which starts
    better and gained nothing where this was measured; cma-h1, cma), or a checkpoint
    (FILE.safetensors) of cma or seq2seq."""
    paths: int = 120
    """Number of paths to sample; a third to half of them is set aside."""
    min_length_m: float = SampleConfig.min_length_m
    """Minimum length of a path [m]."""
    min_crossings: int = SampleConfig.min_crossings
    """Minimum number of room-to-room transitions per path."""
    steps: int = 300
    """Training steps."""
    learning_rate: float = 5e-4
    """Highest learning rate; it rises during a tenth of the steps and falls along a cosine."""
    seed: int = 0
    """Random seed of paths, rooms and training."""
    threads: int = 0
    """Number of torch threads; 0 uses one per core."""
    out: Path | None = None
    """Output folder; defaults to runs/adapt-<scene>-<robot>."""

    def check(self) -> None:
        """Raise InputError if a number is too small, or the controller follows no policy."""
        check_name("--controller", self.controller, ("auto", "flash", "speed"))
        check_numbers(self, 1, "paths", "steps")
        check_numbers(self, 0, "min_crossings", "threads", "workers")
        if not self.learning_rate > 0:
            raise InputError(f"--learning-rate {self.learning_rate:g}; valid: above 0")
