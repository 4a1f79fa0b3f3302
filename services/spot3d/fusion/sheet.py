"""A real plane as the map holds it: flat, but for a slow warp from the lens and from drift."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.footprint import convex_hull, outer_points, smallest_rectangle
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.sheet_fit import FITTED_MIN, facing_points, fitted_warp, in_plane_axes
from spot3d.fusion.sheet_kernels import (
    cells_at_sheet,
    distance_of,
    distances,
    in_long_groups,
    mark_flat,
    mark_sheet,
    with_neighbours,
)
from spot3d.fusion.structure import StructurePlane
from spot3d.fusion.surface import Surface, near_pairs

_REACH = 0.03
"""Cells this near to a remembered plane take part in the fit of its sheet, metres."""
_SPREADS = 2.5
"""A sheet is this many standard deviations of its points thick, each way."""
_LASTING_SHARE = 0.1
"""A plane that this share of the keyframes removed is a supporting plane, whatever its extent."""


@dataclass(frozen=True, slots=True)
class Sheet:
    """A plane with a quadratic warp.

    plane: (4,) float64 world, before the warp. axes: (2, 3) float64, in-plane axes divided by the half extents;
    middle: (3,) float64; warp: (6,) float64 metres, coefficients of 1, x, y, x^2, xy, y^2 of the in-plane
    coordinates in [-1, 1]; spread: standard deviation of the points about the sheet, metres.
    """

    plane: NDArray[np.float64]
    axes: NDArray[np.float64]
    middle: NDArray[np.float64]
    warp: NDArray[np.float64]
    spread: float

    def distance(self, points: NDArray[np.float32]) -> NDArray[np.float64]:
        """Signed distances in metres of (n, 3) world points; beyond the sheet's extent its rim is continued."""
        distance: NDArray[np.float64] = distances(points, *self.shape)
        return distance

    def distance_of(self, point: NDArray[np.float64]) -> float:
        """Signed distance in metres of one (3,) world point."""
        return float(distance_of(point, *self.shape))

    @property
    def shape(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """What kernels need: plane, axes, middle, warp."""
        return self.plane, self.axes, self.middle, self.warp


def fit_sheet(
    plane: NDArray[np.float64],
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    reach: float,
    warped: bool,
) -> Sheet | None:
    """Fit a sheet to the points that lie within `reach` metres of a plane and face its way; None if none do.

    points, normals: (n, 3) float32 world. warped: let it bend (else it only shifts and tilts).
    By least squares that hardly weigh what is far off, so that what stands on the sheet does not lift it.
    """
    fitted = facing_points(points, normals, plane, reach)
    if fitted.shape[1] < FITTED_MIN:
        return None
    return Sheet(plane, *fitted_warp(fitted, plane, reach, warped))


@dataclass(frozen=True, slots=True)
class StructureSheet:
    """A sheet that is no object: thickness: half, metres.

    cells: (n,) bool, the coarse cells that it takes in; near: (n,) bool, those beside its surface as well.
    """

    sheet: Sheet
    thickness: float
    cells: NDArray[np.bool_]
    near: NDArray[np.bool_]


def find_sheets(coarse: Surface, planes: list[StructurePlane], settings: FusionSettings) -> list[StructureSheet]:
    """Supporting planes, walls and floors among the keyframes' planes, as the map now shows them.

    A plane counts where keyframes kept removing it, or where its connected surface reaches farther than an
    object can (eps_max). coarse: all of the map in cells of some centimetres.
    """
    found: list[StructureSheet] = []
    pairs = near_pairs(coarse)
    begin = np.append(0, np.cumsum(np.bincount(pairs[:, 0], minlength=len(coarse.centre))))
    lasting = [item.removed_share >= _LASTING_SHARE for item in planes]
    for item, warped in zip(planes, lasting, strict=True):
        sheet = fit_sheet(item.plane, coarse.centre, coarse.normal, _REACH, warped)
        if sheet is None or sheet.spread > _REACH / 3:
            continue  # no denser there than anywhere: the plane is gone, or never was one
        thickness = float(np.clip(_SPREADS * sheet.spread, settings.plane_distance, 2 * settings.plane_distance))
        cells, facing = cells_at_sheet(coarse.centre, coarse.normal, thickness + coarse.edge / 2, *sheet.shape)
        if not warped:
            cells = facing = in_long_groups(coarse.centre, pairs, begin, facing, settings.size_max)
        if facing.any():
            found.append(StructureSheet(sheet, thickness, cells, facing))
    near = _with_neighbours(pairs, [item.near for item in found])
    return [replace(item, cells=item.cells & beside, near=beside) for item, beside in zip(found, near, strict=True)]


def on_sheets(surface: Surface, sheets: list[StructureSheet]) -> NDArray[np.bool_]:
    """Which cells lie on a sheet: within its thickness, facing its way unless very near, where it reaches.

    What goes down from its rim is the side of the board that it is the top of.
    The sheets' cells are the blocks of the surface. Returns (n,) bool.
    """
    structure = np.zeros(len(surface.centre), np.bool_)
    for item in sheets:
        mark_sheet(
            structure,
            surface.centre,
            surface.normal,
            surface.blocks.first,
            item.cells,
            item.near,
            item.thickness,
            *item.sheet.shape,
        )
    return structure


def lying_flat(surface: Surface, coarse: Surface, levels: list[tuple[Sheet, NDArray[np.float32]]]) -> NDArray[np.bool_]:
    """Cells of the tops of thin flat things: facing as a level sheet and a few centimetres above it. (n,) bool

    coarse: the blocks of the surface.
    levels: sheets, and (m, 3) points of each, which tell how far it reaches: a shelf says nothing of a tall box
    before it.
    """
    flat = np.zeros(len(surface.centre), np.bool_)
    for item, points in levels:
        rectangle = _rectangle(item.plane[:3], points)
        first, reach = surface.blocks.first, np.sqrt(3) * coarse.edge
        mark_flat(flat, surface.centre, surface.normal, first, coarse.centre, reach, *item.shape, *rectangle)
    return flat


def _with_neighbours(pairs: NDArray[np.uint32], members: list[NDArray[np.bool_]]) -> list[NDArray[np.bool_]]:
    """The members of each of several sets of cells, (n,) bool, and those near them. pairs: near cells."""
    if not members:
        return []
    near = with_neighbours(pairs, np.packbits(np.stack(members), axis=0))
    return list(np.unpackbits(near, axis=0, count=len(members)).view(np.bool_))


def _rectangle(
    normal: NDArray[np.float64], points: NDArray[np.float32]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The smallest rectangle in a plane around (n, 3) points: axes over half extents (2, 3), and middle (3,)."""
    axes, footprint = in_plane_axes(normal), np.ascontiguousarray((points @ in_plane_axes(normal).T).T)
    yaw, _ = smallest_rectangle(convex_hull(outer_points(footprint)))
    sides = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    along = sides @ footprint
    low, high = along.min(axis=1), along.max(axis=1)
    half = np.maximum(high - low, 1e-3) / 2
    return sides @ axes / half[:, None], (low + high) / 2 @ sides @ axes
