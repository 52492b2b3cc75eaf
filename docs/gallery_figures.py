"""What the gallery shows of an example: the figure of the Axes that each block of its code has made."""

from pathlib import Path

from matplotlib.axes import Axes
from sphinx_gallery.scrapers import figure_rst

from gsp.charts import png

SHOWN = "__shown_axes__"


def keep(block, block_vars, gallery_conf) -> str:
    """Write the figure of every Axes among the example's names that no earlier block has shown."""
    names = block_vars["example_globals"]
    shown = names.setdefault(SHOWN, [])
    files = []
    for value in list(names.values()):
        if not isinstance(value, Axes) or any(value is axes for axes in shown):
            continue
        shown.append(value)
        file = Path(next(block_vars["image_path_iterator"]))
        file.write_bytes(png(value))
        files.append(str(file))
    return figure_rst(files, gallery_conf["src_dir"])
