"""What boxes stand on: the level sheets, how noisy they are, and what they do to the boxes at them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D
from spot3d.fusion.boxes import share_inside, with_bottom
from spot3d.fusion.selection import MapPoints
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.sheet import Sheet, StructureSheet
from spot3d.fusion.sheet_kernels import BOARD, FACING
from spot3d.fusion.support_kernels import count_foreign, count_touching, on_long_sides, spread_about
from spot3d.fusion.surface import Surface

_CLEARANCE_SHARE = 0.15
"""The clearance never takes more than this share of an object's height."""
_LEVEL = 0.95
"""Cosine to the up direction (18 degrees) from which a sheet is level."""
_SAMPLE = 50_000
"""About as many of the map's points tell how noisy its sheets are."""
_CROSSED = 0.05
"""A support that covers this share of a box's footprint, inside the box, runs through it."""
LEANT_ON = 0.5
"""A support that covers less of the footprint of what stands at its edge is leant on, not crossed."""
_BESIDE = 0.1
"""So far beside a thing it is looked on which of its sides a support is, metres."""
_ONE_SIDE = 0.75
"""What has this share of a support's nearby cells on one side stands at its edge, not on it."""
_BENEATH = np.array([0.02, 0.02, np.inf])
"""What goes on below a support may lean so far out of its upper part's footprint, metres."""
_CONTINUED = 0.5
"""Share of a thing's points beneath the footprint of one above that makes it that one's lower part."""
_RIM = 1.5
"""A coarse cell within this many edges of one of a support's touches it."""
_RIM_SHARE = 0.5
"""A thing that touches a support with this share of its cells is the support's own rim."""


@dataclass(frozen=True, slots=True)
class Support:
    """A level sheet, and how far above it its own points reach: the clearance, metres.

    cells: (n,) coarse cells of its upper side; centre: (n, 3) float32 metres; edge: of a cell, metres.
    """

    sheet: Sheet
    clearance: float
    cells: NDArray[np.int64]
    centre: NDArray[np.float32]
    edge: float

    def above(self, box: Box3D) -> float:
        """Height of the box's middle above the support, metres."""
        return self.sheet.distance_of(box.centre)

    def is_beside(self, box: Box3D) -> bool:
        """Whether the support is near to a box, but on one of its long sides only."""
        low, high = on_long_sides(self.centre, box.centre, box.rotation, box.size, _BESIDE)
        return bool(max(low, high) >= _ONE_SIDE * max(1, low + high))

    def sides(self, points: NDArray[np.float32]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which of (n, 3) points are clear above the support, and which below."""
        height = self.sheet.distance(points)
        return height > self.clearance, height < -self.clearance


def find_supports(
    points: MapPoints, coarse: Surface, sheets: list[StructureSheet], up: NDArray[np.float64], settings: FusionSettings
) -> list[Support]:
    """The level ones among the sheets. points, coarse: all of the map, and its coarse cells."""
    supports = []
    step = max(1, len(points) // _SAMPLE)
    for item in sheets:
        normal = item.sheet.plane[:3].astype(np.float32)
        if item.sheet.plane[:3] @ up <= _LEVEL:
            continue
        spread = spread_about(points.xyz, points.normal, coarse.cell_of_point, item.cells, step, *item.sheet.shape)
        noise = 1.4826 * spread
        clearance = max(settings.standing_clearance, item.thickness, settings.noise_gate * noise)
        cells = np.flatnonzero(item.cells & (coarse.normal @ normal > FACING))
        if not len(cells):
            continue  # none of its upper side is seen
        supports.append(Support(item.sheet, clearance, cells, coarse.centre[cells], coarse.edge))
    return supports


def standing(box: Box3D, supports: list[Support]) -> Box3D:
    """The box with its bottom on the support next to it, if there is one, but for the support's noise.

    What ends within a board's thickness of a support's top stands on it.
    """
    half = float(box.size[2]) / 2
    for item in supports:
        above = item.above(box)
        if abs(above - half) < BOARD and above + half > 0:
            lift = min(item.clearance, _CLEARANCE_SHARE * (half + above))
            return with_bottom(box, float(box.rotation[:, 2] @ box.centre) - above + lift)
    return box


def crossed_by(box: Box3D, own: NDArray[np.int32], supports: list[Support], share: float = _CROSSED) -> Support | None:
    """The support whose upper side runs through a box, if any does: no upright box holds the object alone then.

    own: coarse cells of the object's points, which are not the support's. share: of the box's footprint, which the
    support must cover.
    """
    for item in supports:
        if abs(item.above(box)) >= float(box.size[2]) / 2 - item.clearance:
            continue
        foreign = count_foreign(item.centre, item.cells, own, box.centre, box.rotation, box.size)
        if foreign * item.edge**2 > share * float(box.size[0] * box.size[1]):
            return item
    return None


def edge_groups(boxes: list[Box3D], samples: list[NDArray[np.float32]], supports: list[Support]) -> list[list[int]]:
    """Which things belong together: what stands at a support's edge, and what goes on beneath it below the board.

    The board takes what is at its own level from a chair's back that touches it. samples: (n, 3) float32 metres,
    points of each box's thing. Each number is in one group.
    """
    group_of = {k: [k] for k in range(len(boxes))}
    centres = np.array([box.centre for box in boxes], np.float32).reshape(-1, 3)
    half = [float(box.size[2]) / 2 for box in boxes]
    for item in supports:
        ends = [(a - h, a + h) for a, h in zip(item.sheet.distance(centres).tolist(), half, strict=True)]
        lower = [k for k, (_, top) in enumerate(ends) if -2 * BOARD < top < item.clearance]
        for k, (bottom, top) in enumerate(ends):
            if not (k in group_of and abs(bottom) < BOARD and top > item.clearance and item.is_beside(boxes[k])):
                continue
            for j in lower:
                if j in group_of and share_inside(samples[j], boxes[k], _BENEATH) >= _CONTINUED:
                    group_of[k] += group_of.pop(j)
    return list(group_of.values())


def is_rim(box: Box3D, own: NDArray[np.int32], centre: NDArray[np.float32], supports: list[Support]) -> bool:
    """Whether a thing is a support's own front: it begins at the support's level, goes down, and keeps to its rim.

    own: (n,) coarse cells of the thing, each perhaps several times; centre: (m, 3) float32 of all coarse cells.
    """
    for item in supports:
        if not -BOARD < item.above(box) + float(box.size[2]) / 2 < item.clearance:
            continue
        touching, cells = _RIM * item.edge, centre[np.unique(own)]
        low, high = cells.min(axis=0) - touching, cells.max(axis=0) + touching
        around = ((item.centre > low) & (item.centre < high)).all(axis=1)
        if count_touching(cells, item.centre[around], touching) > _RIM_SHARE * len(cells):
            return True
    return False
