"""Put a run's pictures side by side: python examples/overview.py RUN OUT.jpg.

From left to right: the scan as it was, the repaired floor, and what a robot saw.
"""

import sys
from pathlib import Path

from PIL import Image

HEIGHT_PX = 600
SHOWN = 0.636  # of the strip: four of its six frames


def main(run: Path, out: Path) -> None:
    (scene,), (strip, *_) = (run / "scenes").iterdir(), sorted((run / "report/strips").iterdir())
    frames = Image.open(strip)
    pictures = [
        Image.open(scene / "before.png"),
        Image.open(scene / "after.png"),
        frames.crop((0, 0, round(frames.width * SHOWN), frames.height)),
    ]
    widths = [round(picture.width * HEIGHT_PX / picture.height) for picture in pictures]
    overview = Image.new("RGB", (sum(widths), HEIGHT_PX))
    for number, picture in enumerate(pictures):
        resized = picture.convert("RGB").resize((widths[number], HEIGHT_PX))
        overview.paste(resized, (sum(widths[:number]), 0))
    overview.save(out, quality=85)
    print(f"{out}: {overview.width} × {overview.height} px")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
