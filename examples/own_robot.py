"""Start a robot of your own from a shipped one: python examples/own_robot.py my_robot."""

import sys
from pathlib import Path

from vlnpe.collectors.robots import get_robot
from vlnpe.collectors.robots.folder.export import export_robot


def main(folder: Path) -> None:
    export_robot(get_robot("jetbot"), folder, None)  # robot.toml and model.xml, to edit
    facts = folder / "robot.toml"
    title = get_robot(str(folder)).title
    facts.write_text(facts.read_text().replace(title, "My own robot"))
    robot = get_robot(str(folder))  # reads and checks the folder, as `--robot my_robot` does
    model = robot.build_model()
    print(f"{robot.name}: {robot.title}, {robot.mass_kg:.1f} kg, {model.nu} motors")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
