"""A table of numbers as Markdown and JSON, with curves as pictures."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

from spot3d.drawing.charts import Curve, recall_plot
from spot3d.drawing.picture import write_picture

Cell = str | int | float | None


@dataclass(frozen=True, slots=True)
class Column:
    """A column's heading, and the decimals of its numbers."""

    name: str
    digits: int = 2


def columns(*names: str, digits: int = 2) -> tuple[Column, ...]:
    """Columns of these names, whose numbers have this many decimals."""
    return tuple(Column(name, digits) for name in names)


@dataclass(slots=True)
class Table:
    """Rows under columns. name: that of the command line; notes: sentences that a reader must know."""

    name: str
    title: str
    columns: tuple[Column, ...]
    rows: list[tuple[Cell, ...]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    curves: list[Curve] = field(default_factory=list)

    def add(self, *cells: Cell) -> None:
        """Append a row. Raises ValueError unless it has a cell for each column."""
        if len(cells) != len(self.columns):
            raise ValueError(f"{len(cells)} cells for {len(self.columns)} columns")
        self.rows.append(cells)


def to_markdown(table: Table) -> str:
    """The table in Markdown with its title and notes. Undefined values are dashes."""
    heads = [column.name for column in table.columns]
    rows = [[_text(cell, c.digits) for cell, c in zip(row, table.columns, strict=True)] for row in table.rows]
    widths = [max(3, *(len(row[i]) for row in [heads, *rows])) for i in range(len(heads))]
    words = [bool(table.rows) and isinstance(table.rows[0][i], str) for i in range(len(heads))]
    rule = ["-" * width if word else "-" * (width - 1) + ":" for width, word in zip(widths, words, strict=True)]
    lines = [f"### {table.title}", "", *(_line(row, widths, words) for row in [heads, rule, *rows])]
    return "\n".join([*lines, *(["", *(f"- {note}" for note in table.notes)] if table.notes else [])]) + "\n"


def to_document(table: Table) -> dict[str, Any]:
    """The table for JSON: each row an object by column names. Undefined values are null."""
    names = [column.name for column in table.columns]
    return {
        "table": table.name,
        "title": table.title,
        "columns": names,
        "rows": [dict(zip(names, map(_value, row), strict=True)) for row in table.rows],
        "notes": table.notes,
        "curves": [_curve(curve) for curve in table.curves],
    }


def write_tables(path: Path, record: dict[str, Any], tables: Sequence[Table]) -> None:
    """Write the record of a measurement and its tables as JSON. Raises OSError if that fails."""
    document = {"record": record, "tables": [to_document(table) for table in tables]}
    path.write_text(json.dumps(document, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def write_plots(folder: Path, tables: Sequence[Table]) -> None:
    """Write a plot TABLE-DATA.png for each data set of each table with curves. Raises OSError if that fails."""
    folder.mkdir(parents=True, exist_ok=True)
    for table in tables:
        for data in dict.fromkeys(curve.data for curve in table.curves):
            picture = recall_plot(f"{data}: {table.title}", [curve for curve in table.curves if curve.data == data])
            name = data.translate(str.maketrans(": /", "---"))
            write_picture(folder / f"{table.name}-{name}.png", picture)


def _curve(curve: Curve) -> dict[str, Any]:
    values = [_value(value) for value in curve.recall.tolist()]
    over = {"levels": list(curve.levels), "rate": values}
    over = over if curve.levels else {"iou": curve.thresholds.tolist(), "recall": values}
    return {"data": curve.data, "name": curve.name, **over}


def _line(cells: Iterable[str], widths: list[int], words: list[bool]) -> str:
    padded = (c.ljust(w) if word else c.rjust(w) for c, w, word in zip(cells, widths, words, strict=True))
    return f"| {' | '.join(padded)} |"


def _text(cell: Cell, digits: int) -> str:
    value = _value(cell)
    if value is None:
        return "-"
    return f"{value:.{digits}f}" if isinstance(value, float) else str(value).replace("|", "\\|")


def _value(cell: Cell) -> Cell:
    return None if isinstance(cell, float) and not isfinite(cell) else cell
