"""The tables about robots: gap between flash and physics, locomotion, data of several robots."""

from benchmarks.evidence.records import BODYLESS, FULL, H1_DATA, Claim, Row, Table, Test, Training

ROBOTS = ("h1", "aliengo", "jetbot")


def gap_table() -> Table:
    """Return the table of models trained on flash data and tested on robots."""
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


def controller_table() -> Table:
    """Return the table of training and testing with and without locomotion."""
    data = {"flash": "without", "speed": "with"}
    trained = {name: Training((f"h1/{name}",)) for name in data}

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


def mixtures_table() -> Table:
    """Return the table of data of several robots, each tested on every robot."""
    own = {name: (f"{name}/speed",) for name in ROBOTS}
    three = tuple(f"{name}/speed" for name in ROBOTS)
    data = {"VLN-CE style": BODYLESS, **own}
    data |= {"three robots": three, "three + VLN-CE style": (*three, *BODYLESS)}
    tests = {"vlnce": Test(), **{name: Test(name, "speed") for name in ROBOTS}}
    rows, claims = [], []
    joint = Training(three, passes=True)
    for robot, test in tests.items():
        for name, walks in data.items():
            rows.append(Row(f"{name} → {robot}", Training(walks), test))
        if robot in ROBOTS:
            rows.append(Row(f"three robots, equal passes → {robot}", joint, test))
            longer = f"{robot}, three times the steps → {robot}"
            rows.append(Row(longer, Training(data[robot], longer=3), test))
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
                Claim(
                    f"the same, with equal passes over {robot}'s data",
                    "SR",
                    f"three robots, equal passes → {robot}",
                    f"{robot} → {robot}",
                    published=False,
                ),
                Claim(
                    f"the same, with equal passes over {robot}'s data and equal steps",
                    "SR",
                    f"three robots, equal passes → {robot}",
                    longer,
                    published=False,
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
        if robot == "h1":
            pair = ("h1/speed", "aliengo/speed")
            helped = "adding the quadruped's data helps the humanoid"
            falls = "with the quadruped's data it falls more"
            both, passes = "h1 + aliengo → h1", "h1 + aliengo, equal passes → h1"
            own, steps = "h1 → h1", "h1, twice the steps → h1"
            rows += [
                Row(both, Training(pair), test),
                Row(passes, Training(pair, passes=True), test),
                Row(steps, Training(H1_DATA, longer=2), test),
            ]
            claims += [
                Claim(text, metric, more, less, published=False)
                for text, metric, more, less in (
                    (helped, "SR", both, own),
                    (f"{helped}, equal passes over its own", "SR", passes, own),
                    (f"{helped}, equal passes and equal steps", "SR", passes, steps),
                    (falls, "FR", both, own),
                    (falls, "FR", passes, steps),
                )
            ]
    paper = (
        "SR on val_unseen, VLN-CE / own / three / three + VLN-CE: humanoid 16.0 / 18.8 / 19.3 / "
        "26.9; quadruped 4.7 / 17.0 / 17.2 / 23.8; wheeled 11.0 / 12.0 / 15.8 / 20.0; flash 21.7 / "
        "– / – / 32.6."
    )
    return Table(4, "Data of several robots", tuple(rows), tuple(claims), paper)
