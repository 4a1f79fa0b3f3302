"""The curves of tables as pictures in a folder."""

from collections.abc import Sequence
from pathlib import Path

from spot3d.drawing.picture import write_picture
from spot3d.drawing.recall_plot import recall_plot
from spot3d.evaluate.table import Table


def write_plots(folder: Path, tables: Sequence[Table]) -> None:
    """Write a plot TABLE-DATA.png for each data set of each table with curves. Raises OSError where that fails."""
    folder.mkdir(parents=True, exist_ok=True)
    for table in tables:
        for data in dict.fromkeys(curve.data for curve in table.curves):
            picture = recall_plot(f"{data}: {table.title}", [curve for curve in table.curves if curve.data == data])
            name = data.translate(str.maketrans(": /", "---"))
            write_picture(folder / f"{table.name}-{name}.png", picture)
