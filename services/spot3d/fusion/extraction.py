"""From the points of the 3D heatmap to objects, over whole surfaces (paper, Sec. IV-D)."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D
from spot3d.fusion.boxes import Cluster, Part, merge_contained, sampled, upright_box
from spot3d.fusion.hollow import hollow_groups
from spot3d.fusion.identity import FoundObject
from spot3d.fusion.segments import split_at_creases
from spot3d.fusion.selection import MapPoints
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.sheet import find_sheets, lying_flat, on_sheets
from spot3d.fusion.structure import StructurePlane
from spot3d.fusion.support import LEANT_ON, Support, crossed_by, edge_groups, find_supports, is_rim, standing
from spot3d.fusion.surface import (
    Surface,
    gather_cells,
    mean_of_cells,
    only,
    points_of_cells,
    rows_of_groups,
    sums_of_groups,
    taken,
)
from spot3d.kernel import kernel

_TRIM = 0.005
"""Share of an object's points that may lie beyond each face of its box."""
_COVERED = 0.5
"""An object's surface is seen over at least this share of its box's largest face; a triangle's is."""
_PEAK = 0.5
"""Where even the hottest points are colder than this, eps falls in proportion: a frame's maximum wanders."""
_COLD = 0.4
"""Points below this share of eps belong to no object and are not looked at: a heatmap's halo around what is warm."""
_WARM = 0.5
"""A segment whose mean heat is at least this share of eps may be a part of an object."""


def find_objects(points: MapPoints, planes: list[StructurePlane], settings: FusionSettings) -> list[FoundObject]:
    """Objects among the map's frequent points, most confident first, not yet numbered.

    planes: the keyframes' distinct planes, the supporting one first; its normal is up. Without any there are no
    objects: nothing is known to stand on anything.
    """
    objects = [_describe(cluster, points) for cluster in find_clusters(points, planes, settings)]
    return sorted(objects, key=lambda item: -item.confidence)


def find_clusters(points: MapPoints, planes: list[StructurePlane], settings: FusionSettings) -> list[Cluster]:
    """The clusters of points that are objects by their heat and size. planes: as in `find_objects`."""
    if not planes or len(points) == 0:
        return []
    return [cluster for cluster in _by_surface(points, planes, settings) if _plausible(cluster.box, settings)]


def _by_surface(points: MapPoints, planes: list[StructurePlane], settings: FusionSettings) -> list[Cluster]:
    """Whole surfaces between creases and structure, each judged by its mean heat, boxed down to its support."""
    up = planes[0].plane[:3]
    heat_min = settings.heat_min * min(1.0, peak_heat(points) / _PEAK)
    surface, coarse = gather_cells(points.xyz, points.normal, points.heat, settings.cell, _COLD * heat_min)
    supports: list[Support] = []
    if settings.plane_removal:
        sheets = find_sheets(coarse, planes, settings)
        supports = find_supports(points, coarse, sheets, up, settings)
        surface = only(surface, ~on_sheets(surface, sheets))
    coarse_cell = surface.blocks.of_cells()
    flat = lying_flat(surface, coarse, [(item.sheet, item.centre) for item in supports])
    labels = split_at_creases(surface, flat, settings.crease, settings.segment_cells, settings.seamed_cells)
    segments = _warm_segments(labels, surface, heat_min, settings.segment_cells)

    def hot(cells: NDArray[np.int64]) -> bool:
        return bool(mean_of_cells(surface.heat, surface.size, cells) >= heat_min)

    def box_of(members: NDArray[np.float32], lengthwise: bool = False) -> Box3D:
        return standing(upright_box(members, up, turn=True, trim=_TRIM, lengthwise=lengthwise), supports)

    parts = _parts(segments, surface, coarse_cell, supports, box_of, up, settings)
    holds = [hot(part.rows) for part in parts]
    merged = merge_contained(parts, holds, surface.centre, box_of, settings.contained_share)
    merged = [cells for cells in merged if hot(cells)]
    found = []
    for cells, rows in zip(merged, points_of_cells(surface, merged), strict=True):
        box = box_of(taken(points.xyz, rows), lengthwise=True)
        rim = is_rim(box, coarse_cell[cells], coarse.centre, supports)
        if not rim and _covered(len(cells) * settings.cell**2, box):
            found.append(Cluster(rows, box))
    return found


def _parts(
    segments: list[NDArray[np.int64]],
    surface: Surface,
    coarse_cell: NDArray[np.int32],
    supports: list[Support],
    box_of: Callable[[NDArray[np.float32]], Box3D],
    up: NDArray[np.float64],
    settings: FusionSettings,
) -> list[Part]:
    """Segments cut at the supports that run through them, and those joined that are one thing by their shape."""

    def boxed(cells: NDArray[np.int64]) -> Part:
        sample = sampled(surface.centre, cells)
        return Part(cells, sample, box_of(sample))

    def together(group: list[int]) -> Part:
        return boxed(np.concatenate([parts[k].rows for k in group])) if len(group) > 1 else parts[group[0]]

    # Before anything is joined: what stands on a support is no part of what stands beneath it, though one box be
    # around both.
    parts: list[Part] = []
    for whole in map(boxed, segments):
        crossing = crossed_by(whole.box, coarse_cell[whole.rows], supports)
        if crossing is None:
            parts.append(whole)
        else:
            sides = [whole.rows[side] for side in crossing.sides(surface.centre[whole.rows])]
            parts += [boxed(side) for side in sides if len(side) >= settings.segment_cells]
    samples = [part.sample for part in parts]
    groups = hollow_groups([part.rows for part in parts], samples, surface.normal, up, settings.size_max)
    parts = [together(group) for group in groups]
    groups = edge_groups([part.box for part in parts], [part.sample for part in parts], supports)
    joined: list[Part] = []
    for group in groups:
        whole = together(group)
        split = len(group) > 1 and crossed_by(whole.box, coarse_cell[whole.rows], supports, LEANT_ON) is not None
        joined += [parts[k] for k in group] if split else [whole]
    return joined


def peak_heat(points: MapPoints) -> float:
    """The heat that the hottest hundredth of the points reaches: how hot this scene's objects get."""
    sample = points.heat[:: max(1, len(points) // 10_000)]
    return float(np.quantile(sample, 0.99))


def _warm_segments(
    segments: NDArray[np.int32], surface: Surface, heat_min: float, cells_min: int
) -> list[NDArray[np.int64]]:
    """The cells of each segment that is warm and large enough to be an object or part of one."""
    size, heat = sums_of_groups(segments, surface.heat)
    kept = (heat >= _WARM * heat_min * size) & (size >= cells_min)
    number = np.where(kept, np.cumsum(kept) - 1, -1).astype(np.int32)
    return rows_of_groups(segments, size, number, int(np.count_nonzero(kept)))


def _covered(area: float, box: Box3D) -> bool:
    """Whether so much surface, square metres, would cover enough of the largest face of a box."""
    _, middle, longest = np.sort(box.size)
    return area >= _COVERED * float(middle * longest)


def _describe(cluster: Cluster, points: MapPoints) -> FoundObject:
    """The object that the cluster's points form, not yet numbered."""
    rows = cluster.rows
    heat, views = _heat_and_views(points.heat, points.frequency, rows)
    # By columns, which is several times faster than `mean(axis=0)`.
    colour = np.array([column.mean(dtype=np.float64) for column in sampled(points.colour, rows).T])
    return FoundObject(0, cluster.box, min(max(heat, 0.0), 1.0), int(views), len(rows), colour)


@kernel("UniTuple(f8, 2)(f4[::1], f4[::1], i8[:])")
def _heat_and_views(
    heat: NDArray[np.float32], frequency: NDArray[np.float32], rows: NDArray[np.int64]
) -> tuple[float, float]:
    """The mean of these rows' heat, and the most that one was seen."""
    total, most = 0.0, np.float32(0)
    for row in rows:
        total += heat[row]
        most = max(most, frequency[row])
    return total / len(rows), float(most)


def _plausible(box: Box3D, settings: FusionSettings) -> bool:
    """Whether a box has an object's size: eps_min, as its cross-section, and eps_max in 3D, and the least volume.

    What is thinner than eps_p is a piece of a plane.
    """
    shortest, middle, longest = np.sort(box.size)
    thick = shortest >= settings.plane_distance
    return bool(
        thick and middle >= settings.size_min and longest <= settings.size_max and box.volume >= settings.volume_min
    )
