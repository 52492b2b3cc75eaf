"""Draw the screenshots of docs/demos.md again, by a browser: `PYTHONPATH=. python docs/images/screens.py`."""

import tempfile
from io import BytesIO
from pathlib import Path

from PIL import Image

import gsp
from tests.demos.browser import windows

FOLDER = Path(__file__).parent
# Narrow, so that what is written on a page can be read in a column of the site.
WIDTH, SCALE = 1000, 1.5
# Name of the picture: the scene, the step of its story from 0, and whether the page is dark.
SCREENS = {
    "sleigh": ("chaplygin_sleigh", 7, False),
    "canard": ("van_der_pol", 7, True),
    "koper": ("koper", 4, False),
    "shishkova": ("shishkova", 4, False),
    "lindemann": ("lindemann", 3, False),
}


def main() -> None:
    """Write the screenshots beside this file."""
    with tempfile.TemporaryDirectory() as scratch:
        for page in windows():
            for name, (scene, step, is_dark) in SCREENS.items():
                file = gsp.write_demo(gsp.models.load(scene), Path(scratch, f"{name}.html"))
                page.open(file, width=WIDTH)
                page.run(
                    "turnTo(arguments[0]); play(false); if (arguments[1]) setTheme('dark');", step, is_dark
                )
                page.settle()
                page.measured()
                page.window(WIDTH, page.run("return document.documentElement.scrollHeight"), SCALE)
                page.settle()
                taken = Image.open(BytesIO(page.driver.get_screenshot_as_png())).convert("RGB")
                # A palette that covers all colours, so that no curve takes the colour of another.
                small = taken.quantize(256, Image.Quantize.MAXCOVERAGE, kmeans=3, dither=Image.Dither.NONE)
                small.save(FOLDER / f"demo-{name}.png", optimize=True)


if __name__ == "__main__":
    main()
