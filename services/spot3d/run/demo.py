"""`spot3d demo`: compares the objects found in the built-in scene with the true ones."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rich.table import Table

from spot3d.boxes import Box3D, iou_matrix_3d
from spot3d.found_object import FoundObject

FOUND_IOU = 0.25
"""Minimum IoU of an object that counts as found."""


@dataclass(frozen=True, slots=True)
class Match:
    """A true object with the found object that overlaps it most; found_id None: nothing overlaps it."""

    name: str
    iou: float
    found_id: int | None

    @property
    def found(self) -> bool:
        """Whether the overlap suffices."""
        return self.iou >= FOUND_IOU


def match_objects(
    true: Sequence[tuple[str, Box3D]], found: Sequence[FoundObject]
) -> tuple[list[Match], list[FoundObject], list[FoundObject]]:
    """Each true object's best match; found objects that are a further box of one; those of none (IoU < 0.25)."""
    iou = iou_matrix_3d([box for _, box in true], [item.box for item in found])
    matches = []
    for row, (name, _) in enumerate(true):
        best = int(iou[row].argmax()) if found else 0
        overlap = float(iou[row, best]) if found else 0.0
        matches.append(Match(name, overlap, found[best].id if overlap > 0 else None))
    best_of_found = iou.max(axis=0, initial=0.0)
    best_ids = {match.found_id for match in matches if match.found}
    further, strangers = [], []
    for item, overlap in zip(found, best_of_found, strict=True):
        if overlap < FOUND_IOU:
            strangers.append(item)
        elif item.id not in best_ids:
            further.append(item)
    return matches, further, strangers


def demo_table(matches: Sequence[Match], further: Sequence[FoundObject], strangers: Sequence[FoundObject]) -> Table:
    """The table that the demo ends with."""
    title = f"found against true objects (found: 3D IoU of {FOUND_IOU:g} or more)"
    table = Table(title=title, title_justify="left")
    for heading in ("object", "IoU", "found as", ""):
        table.add_column(heading, justify="left" if heading in ("object", "") else "right")
    for match in matches:
        number = "-" if match.found_id is None else str(match.found_id)
        verdict = "[green]found" if match.found else "[red]missed"
        table.add_row(match.name, f"{match.iou:.2f}", number, verdict)
    found = sum(match.found for match in matches)
    mean = float(np.mean([match.iou for match in matches])) if matches else 0.0
    table.add_section()
    table.add_row(f"{found} of {len(matches)} found", f"{mean:.2f}", "", "mean IoU")
    table.add_row("further boxes of an object", str(len(further)), "", "")
    table.add_row("boxes that are no object", str(len(strangers)), "", "")
    return table
