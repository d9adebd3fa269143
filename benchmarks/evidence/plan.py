"""The tables: which model is trained on what, under which test it walks, and what is claimed."""

from collections.abc import Mapping

from benchmarks.evidence.records import (
    BODYLESS,
    FULL,
    H1,
    H1_DATA,
    Claim,
    Row,
    Table,
    Test,
    Training,
)
from benchmarks.evidence.robots import controller_table, gap_table, mixtures_table

DEPTH_ONLY = Training(inputs=("depth", "instruction"))
RGB_ONLY = Training(inputs=("rgb", "instruction"))
SEQ2SEQ = Training(model="seq2seq")
RDP = Training(model="rdp")
_FULL, _DEAF, _BLIND = "CMA", "CMA, language-blind", "CMA, vision-blind"


def tables(training_scenes: int) -> Mapping[int, Table]:
    """Return all tables by number; data of `training_scenes` scenes is all data."""
    made = (_senses(), gap_table(), controller_table(), mixtures_table(), _light(), _camera())
    made += (_amount(training_scenes), _humanoid(), _scan())
    return {table.number: table for table in made}


def _blinded(data: tuple[str, ...], test: Test) -> tuple[Row, ...]:
    """Return the rows of a CMA with all senses, and of those without language and vision."""
    return (
        Row(_FULL, Training(data), test),
        Row(_DEAF, Training(data, inputs=("rgb", "depth")), test),
        Row(_BLIND, Training(data, inputs=("instruction",)), test),
    )


def _sense_claims(rival: str) -> tuple[Claim, ...]:
    """Return the claims about `_blinded`; `rival` says why that without vision is weak."""
    vision = f"CMA uses vision; its rival is weak, {rival}"
    return (
        Claim("CMA uses the language", "SR", _FULL, _DEAF, published=False),
        Claim(vision, "SR", _FULL, _BLIND, published=False),
    )


def _senses() -> Table:
    rows = (
        *_blinded(BODYLESS, Test()),
        Row("CMA, depth only", DEPTH_ONLY),
        Row("CMA, RGB only", RGB_ONLY),
        Row("Seq2Seq", SEQ2SEQ),
        Row("RDP", RDP),
        Row("random", "random"),
        Row("forward", "forward"),
        Row("oracle", "oracle"),
    )
    claims = (
        *_sense_claims("it leaves the building through walls"),
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


def _light() -> Table:
    models = {"RGB-D": FULL, "RGB only": RGB_ONLY}
    lights = ("DL5000", "DL300", "CL")
    rows = [
        Row(f"{name}, {light}", training, Test(light=light))
        for name, training in models.items()
        for light in lights
    ]
    rows.append(Row("depth only, any light", DEPTH_ONLY))
    claims = [
        Claim(f"{name} loses SR in {light}", "SR", f"{name}, DL5000", f"{name}, {light}")
        for name in ("RGB only", "RGB-D")
        for light in lights[1:]
    ]
    paper = (
        "SR on val_unseen in DL5000 / DL300 / CL: NaVid (RGB only) 22.4 / 10.0 / 11.2; CMA (RGB-D) "
        "18.8 / 17.4 / 17.0; RDP (RGB-D) 22.0 / 22.3 / 22.8."
    )
    note = (
        "Trained in baked light; rows differ in the light of the test: `DL5000` day, `DL300` "
        "night, `CL` a lamp on the agent. A model that sees no colours walks the same in every "
        "light, and is tested in baked light. Without a body, a model that sees no depth goes "
        "through walls."
    )
    return Table(5, "Light", tuple(rows), tuple(claims), paper, note)


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
    note = (
        "Trained with the camera at 1.25 m; it is moved in the test alone. VLN-PE trains a model "
        "at each height, and its 0.5 m is a quadruped's, under physics."
    )
    return Table(6, "Height and pitch of the camera", tuple(rows), claims, paper, note)


def _amount(training_scenes: int) -> Table:
    amounts = {n: 0 if n == training_scenes else n for n in (10, 20, 40, 80)}
    rows = [Row(f"{n} scenes", Training(scenes=scenes)) for n, scenes in amounts.items()]
    longer = "three times the steps"
    rows += [
        Row(f"{n} scenes, {longer}", Training(scenes=scenes, longer=3))
        for n, scenes in amounts.items()
    ]
    parts = {"quarter": 0.25, "half": 0.5}
    rows += [
        Row(f"all scenes, {name} of their paths", Training(fraction=part))
        for name, part in parts.items()
    ]
    rows.append(Row("all scenes and paths", FULL))
    pairs = [
        (f"{n} scenes are better than 10{end}", f"{n} scenes{end}", f"10 scenes{end}")
        for end in ("", f", {longer}")
        for n in (20, 40, 80)
    ]
    pairs += [
        (f"{longer} are better, of {n} scenes", f"{n} scenes, {longer}", f"{n} scenes")
        for n in (10, 80)
    ]
    everything = "all scenes and paths"
    quarter = "all scenes, quarter of their paths"
    pairs.append(("all paths are better than a quarter", everything, quarter))
    claims = tuple(Claim(text, "SR", more, less, published=False) for text, more, less in pairs)
    return Table(7, "How much data", tuple(rows), claims, "It has no such table.")


def _humanoid() -> Table:
    rows = (
        *_blinded(H1_DATA, H1),
        Row("CMA, 10 scenes", Training(H1_DATA, scenes=10), H1),
        Row("Seq2Seq", Training(H1_DATA, model="seq2seq"), H1),
        Row("RDP", Training(H1_DATA, model="rdp"), H1),
        Row("random", "random", H1),
        Row("forward", "forward", H1),
        Row("oracle", "oracle", H1),
    )
    claims = (
        *_sense_claims("no better than chance"),
        Claim("CMA is better than chance", "SR", _FULL, "random"),
        Claim("CMA is better than straight ahead", "SR", _FULL, "forward", published=False),
        Claim("all scenes are better than 10", "SR", _FULL, "CMA, 10 scenes", published=False),
        Claim("RDP is better than CMA, both from scratch", "SR", "RDP", _FULL),
        Claim("CMA is better than Seq2Seq", "SR", _FULL, "Seq2Seq"),
    )
    paper = (
        "From scratch on H1's data, under physics, val_unseen: SR 15.9 (Seq2Seq), 18.8 (CMA), 22.0 "
        "(RDP); random 3.0."
    )
    return Table(8, "The humanoid's own data, under physics", rows, claims, paper)


def _scan() -> Table:
    exact, scanned = "trained in exact homes", "trained in scanned homes"
    rows = (
        Row(exact, Training(only="exact-apartment-")),
        Row(scanned, Training(only="apartment-")),
    )
    text = "scanned homes train better than exact ones"
    claims = (Claim(text, "SR", scanned, exact, published=False),)
    note = (
        "The same apartments, once in their exact geometry and once through the virtual scan and "
        "its repair, so that a row trains in half of the scenes; each collection samples its own "
        "paths."
    )
    return Table(
        9, "With and without the virtual scan", rows, claims, "It has no such table.", note
    )
