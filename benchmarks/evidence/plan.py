"""The tables: which model is trained on what, under which test it walks, and what is claimed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from vlnpe.formats.core.errors import InputError

ALL_INPUTS = ("rgb", "depth", "instruction")
ROBOTS = ("h1", "aliengo", "jetbot")


@dataclass(frozen=True)
class Training:
    """One row's training; every seed is a training of its own.

    Attributes:
        name: of its folder.
        robots: whose walks, each with its controller, as `robot/controller`.
        model: key of `learning.config.MODELS`.
        inputs: of the model; features of the others are zero.
        scenes: number of training scenes, 0 for all.
        fraction: of the paths in each of them.
        target: robot whose data must be passed over as often as in its own training; "" trains for
            as many optimiser steps as every other row.
    """

    name: str
    robots: tuple[str, ...] = ("vlnce/flash",)
    model: str = "cma"
    inputs: tuple[str, ...] = ALL_INPUTS
    scenes: int = 0
    fraction: float = 1.0
    target: str = ""


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

    def cell(self, seed: int) -> str:
        """Return the name of the evaluation's folder."""
        name = self.policy.name if isinstance(self.policy, Training) else self.policy
        return f"{name}-s{seed}--{self.test.name}"


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
    """

    number: int
    title: str
    rows: tuple[Row, ...]
    claims: tuple[Claim, ...]
    paper: str

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


FULL = Training("cma")
LANGUAGE_BLIND = Training("cma-language-blind", inputs=("rgb", "depth"))
VISION_BLIND = Training("cma-vision-blind", inputs=("instruction",))
DEPTH_ONLY = Training("cma-depth-only", inputs=("depth", "instruction"))
RGB_ONLY = Training("cma-rgb-only", inputs=("rgb", "instruction"))
SEQ2SEQ = Training("seq2seq", model="seq2seq")
RDP = Training("rdp", model="rdp")
H1 = Test("h1", "speed")
_FULL, _DEAF, _BLIND = "CMA", "CMA, language-blind", "CMA, vision-blind"


def tables() -> Mapping[int, Table]:
    """Return all tables by number."""
    made = (_senses(), _gap(), _controller(), _embodiments(), _light(), _camera(), _amount())
    return {table.number: table for table in made}


def _senses() -> Table:
    rows = (
        Row(_FULL, FULL),
        Row(_DEAF, LANGUAGE_BLIND),
        Row(_BLIND, VISION_BLIND),
        Row("CMA, depth only", DEPTH_ONLY),
        Row("CMA, RGB only", RGB_ONLY),
        Row("Seq2Seq", SEQ2SEQ),
        Row("RDP", RDP),
        Row("random", "random"),
        Row("forward", "forward"),
        Row("oracle", "oracle"),
    )
    claims = (
        Claim("CMA uses the language", "SR", _FULL, _DEAF, published=False),
        Claim(
            "CMA uses vision; its rival is weak, it leaves the building through walls",
            "SR",
            _FULL,
            _BLIND,
            published=False,
        ),
        Claim("CMA is better than chance", "SR", _FULL, "random", published=False),
        Claim("RDP is better than CMA, both from scratch", "SR", "RDP", _FULL),
        Claim("CMA is better than Seq2Seq", "SR", _FULL, "Seq2Seq"),
    )
    paper = (
        "It has no blind models, and no numbers of an agent without a body in generated buildings. "
        "From scratch on H1's data, under physics, val_unseen: SR 15.9 "
        "(Seq2Seq), 18.8 (CMA), 22.0 (RDP); random 3.0."
    )
    return Table(1, "Does vision, does language matter?", rows, claims, paper)


def _gap() -> Table:
    flash, shown = "flash, bodyless", {"h1": "H1", "aliengo": "Aliengo", "jetbot": "Jetbot"}
    rows = (
        Row(flash, FULL),
        Row("H1, flash", FULL, Test("h1", "flash")),
        *(Row(f"{shown[name]}, physics", FULL, Test(name, "speed")) for name in ROBOTS),
    )
    claims = [
        Claim(
            f"SR is lower with {shown[name]} under physics", "SR", flash, f"{shown[name]}, physics"
        )
        for name in ROBOTS
    ]
    claims += [
        Claim("the humanoid falls", "FR", "H1, physics", "H1, flash"),
        Claim("the humanoid gets stuck", "StR", "H1, physics", "H1, flash"),
    ]
    paper = (
        "Models trained in VLN-CE lose 10 (Seq2Seq) to 18 (NaVid) points of SR on H1 under "
        "physics; CMA falls in 15 % of val_unseen and gets stuck in 4 %. SR of the same CMA: 21.7 "
        "flash, 16.0 humanoid, 4.7 quadruped, 11.0 wheeled."
    )
    return Table(2, "Trained on flash data, tested on robots", rows, tuple(claims), paper)


def _controller() -> Table:
    data = {"flash": "without", "speed": "with"}
    trained = {name: Training(f"cma-h1-{name}", (f"h1/{name}",)) for name in data}

    def label(way: str, test: str) -> str:
        return f"trained {data[way]} locomotion, tested {data[test]}"

    rows = [
        Row(label(way, test), trained[way], Test("h1", test)) for test in data for way in trained
    ]
    claims = (
        Claim(
            "tested with locomotion, training with it is better",
            "SR",
            label("speed", "speed"),
            label("flash", "speed"),
        ),
        Claim(
            "tested without, training without is better",
            "SR",
            label("flash", "flash"),
            label("speed", "flash"),
        ),
        Claim(
            "training with locomotion makes it fall less",
            "FR",
            label("flash", "speed"),
            label("speed", "speed"),
        ),
    )
    paper = (
        "SR on val_unseen, trained and tested without: 21.3; trained with, tested without: 15.9; "
        "trained without, tested with: 13.5 (falls 25.7 %); with both: 18.8 (falls 18.6 %)."
    )
    return Table(3, "Training and testing with and without locomotion", tuple(rows), claims, paper)


def _embodiments() -> Table:
    own = {name: (f"{name}/speed",) for name in ROBOTS}
    three = tuple(f"{name}/speed" for name in ROBOTS)
    data = {"VLN-CE style": ("vlnce/flash",), **own}
    data |= {"three robots": three, "three + VLN-CE style": (*three, "vlnce/flash")}
    tests = {"vlnce": Test(), **{name: Test(name, "speed") for name in ROBOTS}}
    rows, claims = [], []
    for robot, test in tests.items():
        for name, walks in data.items():
            training = Training(f"cma-on-{_slug(name)}", walks) if walks != FULL.robots else FULL
            rows.append(Row(f"{name} → {robot}", training, test))
        if robot in ROBOTS:
            joint = Training(f"cma-on-three-passes-{robot}", three, target=robot)
            rows.append(Row(f"three robots, equal passes → {robot}", joint, test))
            claims += [
                Claim(
                    f"{robot}'s own data is better for it than VLN-CE's style",
                    "SR",
                    f"{robot} → {robot}",
                    f"VLN-CE style → {robot}",
                ),
                Claim(
                    f"the three robots' data is better for {robot} than its own alone",
                    "SR",
                    f"three robots → {robot}",
                    f"{robot} → {robot}",
                ),
            ]
        claims.append(
            Claim(
                f"three robots with VLN-CE style are best for {robot}",
                "SR",
                f"three + VLN-CE style → {robot}",
                f"{'VLN-CE style' if robot == 'vlnce' else 'three robots'} → {robot}",
            )
        )
    paper = (
        "SR on val_unseen, VLN-CE / own / three / three + VLN-CE: humanoid 16.0 / 18.8 / 19.3 / "
        "26.9; quadruped 4.7 / 17.0 / 17.2 / 23.8; wheeled 11.0 / 12.0 / 15.8 / 20.0; flash 21.7 / "
        "– / – / 32.6."
    )
    return Table(4, "Data of several robots", tuple(rows), tuple(claims), paper)


def _light() -> Table:
    models = {"RGB-D": FULL, "RGB only": RGB_ONLY, "depth only": DEPTH_ONLY}
    lights = ("DL5000", "DL300", "CL")
    rows = [
        Row(f"{name}, {light}", training, Test(light=light))
        for name, training in models.items()
        for light in lights
    ]
    claims = [
        Claim(f"{name} loses SR in {light}", "SR", f"{name}, DL5000", f"{name}, {light}")
        for name in ("RGB only", "RGB-D")
        for light in lights[1:]
    ]
    paper = (
        "SR on val_unseen in DL5000 / DL300 / CL: NaVid (RGB only) 22.4 / 10.0 / 11.2; CMA (RGB-D) "
        "18.8 / 17.4 / 17.0; RDP (RGB-D) 22.0 / 22.3 / 22.8."
    )
    return Table(5, "Light", tuple(rows), tuple(claims), paper)


def _camera() -> Table:
    heights, pitches = (0.5, 1.2, 1.8), (0.0, 15.0, 30.0)
    rows = [Row(f"{h:g} m", FULL, Test(camera_height_m=h)) for h in heights]
    rows += [Row(f"{p:g}° down", FULL, Test(camera_pitch_deg=p)) for p in pitches]
    claims = (
        Claim("a low camera costs SR", "SR", "1.2 m", "0.5 m"),
        Claim("a high camera costs SR", "SR", "1.2 m", "1.8 m", published=False),
    )
    paper = (
        "A CMA trained at 1.8 m instead of 1.2 m gains 3.3 points of SR on H1 (10.3 to 13.6); at "
        "the quadruped's 0.5 m models nearly fail (4.7)."
    )
    return Table(6, "Height and pitch of the camera", tuple(rows), claims, paper)


def _amount() -> Table:
    rows = [Row(f"{n} scenes", Training(f"cma-{n}-scenes", scenes=n)) for n in (10, 20, 40, 80)]
    parts = {"quarter": 0.25, "half": 0.5}
    rows += [
        Row(f"all scenes, {name} of their paths", Training(f"cma-{name}", fraction=part))
        for name, part in parts.items()
    ]
    rows.append(Row("all scenes and paths", FULL))
    claims = (
        Claim("20 scenes are better than 10", "SR", "20 scenes", "10 scenes", published=False),
        Claim("40 scenes are better than 10", "SR", "40 scenes", "10 scenes", published=False),
        Claim(
            "all paths are better than a quarter",
            "SR",
            "all scenes and paths",
            "all scenes, quarter of their paths",
            published=False,
        ),
    )
    return Table(7, "How much data", tuple(rows), claims, "It has no such table.")


def _slug(text: str) -> str:
    return text.lower().replace(" + ", "-and-").replace(" ", "-")
