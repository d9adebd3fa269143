"""What the tables are made of: trainings, tests, rows, claims."""

from dataclasses import dataclass

from vlnpe.formats.core.errors import InputError

ALL_INPUTS = ("rgb", "depth", "instruction")
BODYLESS = ("vlnce/flash",)
_SENSES = {
    ALL_INPUTS: "",
    ("rgb", "depth"): "-language-blind",
    ("instruction",): "-vision-blind",
    ("depth", "instruction"): "-depth-only",
    ("rgb", "instruction"): "-rgb-only",
}

_WORDS = {
    **{"cma": "CMA", "seq2seq": "Seq2Seq", "rdp": "RDP", "rgb-only": "RGB only"},
    **{"depth-only": "depth only", "aliengo": "Aliengo", "jetbot": "Jetbot", "h1": "H1"},
    "vlnce": "bodyless walks",
}


@dataclass(frozen=True)
class Training:
    """One row's training; every seed is a training of its own, and equal ones are made once.

    Attributes:
        robots: whose walks, each with its controller, as `robot/controller`.
        model: key of `learning.config.MODELS`.
        inputs: of the model; features of the others are zero.
        scenes: number of training scenes, 0 for all.
        only: beginning of the names of the scenes that are trained in.
        fraction: of the paths in each of them.
        passes: whether each robot's walks are passed over as often as in a training on them alone,
            by as many times the optimiser steps as there are robots; else all rows make as many
            steps.
        longer: how many times the optimiser steps of other rows.
    """

    robots: tuple[str, ...] = BODYLESS
    model: str = "cma"
    inputs: tuple[str, ...] = ALL_INPUTS
    scenes: int = 0
    only: str = ""
    fraction: float = 1.0
    passes: bool = False
    longer: int = 1

    @property
    def name(self) -> str:
        """Name of its folder, which says all that sets it apart."""
        parts = [self.model, _SENSES[self.inputs]]
        if self.robots != BODYLESS:
            parts.append("-on-" + "-".join(self.robots).replace("/", "-"))
        if self.scenes:
            parts.append(f"-{self.scenes}-scenes")
        if self.only:
            parts.append(f"-in-{self.only.rstrip('-')}")
        if self.fraction < 1.0:
            parts.append(f"-{self.fraction:g}-of-paths")
        if self.passes:
            parts.append("-equal-passes")
        if self.longer > 1:
            parts.append(f"-{self.longer}-times-the-steps")
        return "".join(parts)

    @property
    def label(self) -> str:
        """The same in words, e.g. `CMA on H1 + Aliengo, equal passes`."""
        walks = (robot.split("/") for robot in self.robots)
        whose = [
            _WORDS.get(robot, robot) + (" (flash)" if way == "flash" and robot != "vlnce" else "")
            for robot, way in walks
        ]
        sense = _SENSES[self.inputs].removeprefix("-")
        parts = [
            f"{_WORDS.get(self.model, self.model)} on {' + '.join(whose)}",
            _WORDS.get(sense, sense),
            f"{self.scenes} scenes" if self.scenes else "",
            f"{self.only}… alone" if self.only else "",
            f"{self.fraction:g} of the paths" if self.fraction < 1.0 else "",
            "equal passes" if self.passes else "",
            f"{self.longer} times the steps" if self.longer > 1 else "",
        ]
        return ", ".join(filter(None, parts))


@dataclass(frozen=True)
class Test:
    """What a policy is tested with.

    Attributes:
        robot, controller, light: names, as `vlnpe evaluate` takes them.
        camera_height_m, camera_pitch_deg: of a camera that was moved.
    """

    __test__ = False  # not pytest's

    robot: str = "vlnce"
    controller: str = "flash"
    light: str = "baked"
    camera_height_m: float | None = None
    camera_pitch_deg: float | None = None

    @property
    def name(self) -> str:
        """Part of a folder's name."""
        parts = [self.robot, self.controller, self.light]
        if self.camera_height_m is not None:
            parts.append(f"height-{self.camera_height_m:g}")
        if self.camera_pitch_deg is not None:
            parts.append(f"pitch-{self.camera_pitch_deg:g}")
        return "-".join(parts)


@dataclass(frozen=True)
class Row:
    """One row of a table: a trained policy, or one of the policies without training, and its test.

    Attributes:
        label: unique within its table.
        policy: a training, or the name of a policy of `vlnpe evaluate`.
        test: robot, controller, light and camera.
    """

    label: str
    policy: Training | str
    test: Test = Test()

    @property
    def varies(self) -> bool:
        """Whether seeds differ: of a training, or of the draws of `random`."""
        return isinstance(self.policy, Training) or self.policy == "random"

    @property
    def policy_name(self) -> str:
        """Name of the training, or of the policy without one."""
        return self.policy.name if isinstance(self.policy, Training) else self.policy

    def cell(self, seed: int) -> str:
        """Return the name of the evaluation's folder."""
        return f"{self.policy_name}-s{seed}--{self.test.name}"


@dataclass(frozen=True)
class Claim:
    """A difference between two rows that a finding predicts to be above zero.

    Attributes:
        text: what is said if it is.
        metric: column of the results.
        more, less: labels of the rows.
        published: whether VLN-PE reports it, so that it can be reproduced.
    """

    text: str
    metric: str
    more: str
    less: str
    published: bool = True


@dataclass(frozen=True)
class Table:
    """One table of the page.

    Attributes:
        number: of the table.
        title: as a question.
        rows: in order.
        claims: judged from the intervals.
        paper: what VLN-PE reports for the same question.
        note: what its rows have in common, where that is not plain; else empty.
    """

    number: int
    title: str
    rows: tuple[Row, ...]
    claims: tuple[Claim, ...]
    paper: str
    note: str = ""

    def __post_init__(self) -> None:
        labels = [row.label for row in self.rows]
        if len(set(labels)) < len(labels):
            raise InputError(f"table {self.number}: labels {labels} are not unique")
        for claim in self.claims:
            for label in (claim.more, claim.less):
                if label not in labels:
                    raise InputError(f"table {self.number}: a claim about {label!r}, no row of it")

    def row(self, label: str) -> Row:
        """Return the row with a label."""
        return next(row for row in self.rows if row.label == label)


# What most tables train, and the humanoid's data and test.
FULL = Training()
H1_DATA, H1 = ("h1/speed",), Test("h1", "speed")
