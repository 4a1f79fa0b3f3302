"""A real plane as the map holds it: flat, but for a slow warp from the lens and from drift."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.segments import connected_cells
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.structure import StructurePlane
from spot3d.fusion.surface import Surface, near_pairs

_REACH = 0.03
"""Cells this near to a remembered plane take part in the fit of its sheet, metres."""
_SPREADS = 2.5
"""A sheet is this many standard deviations of its points thick, each way."""
_LASTING_SHARE = 0.1
"""A plane that this share of the keyframes removed is a supporting plane, whatever its extent."""
_FLAT_HEIGHT = 0.03
"""A thin flat thing (a book, a plate) is at most this high, metres."""
_FLAT_FACING = 0.9
"""Cosine (26 degrees) within which the top of a flat thing faces as its support."""
_BOARD = 0.04
"""A table's or a shelf's board is at most this thick, metres."""
_FACING = 0.7
"""Cosine (45 degrees) within which a cell faces as the sheet it lies on."""
_FITS = 6
"""Rounds of reweighting."""


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
        flat = points @ self.plane[:3] + self.plane[3]
        distance: NDArray[np.float64] = flat - _terms(points, self.axes, self.middle) @ self.warp
        return distance


def fit_sheet(
    plane: NDArray[np.float64],
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    reach: float,
    warped: bool,
) -> Sheet | None:
    """Fit a sheet to the points that lie within `reach` metres of a plane and face its way; None if none do.

    points, normals: (n, 3) float32 world. warped: let it bend (else it only shifts and tilts).
    Iteratively reweighted least squares with Tukey's weights, so that what stands on the sheet does not lift it.
    """
    distance = points @ plane[:3] + plane[3]
    near = (np.abs(distance) < reach) & (normals @ plane[:3] > 0.8)
    if np.count_nonzero(near) < 50:
        return None
    points, distance = points[near].astype(np.float64), distance[near]
    middle = np.quantile(points, [0.02, 0.98], axis=0).mean(axis=0)
    axes = _in_plane_axes(plane[:3])
    extent = np.quantile(np.abs((points - middle) @ axes.T), 0.98, axis=0)
    axes = axes / np.maximum(extent, 0.05)[:, None]
    terms = _terms(points, axes, middle)[:, : 6 if warped else 3]
    warp = np.zeros(terms.shape[1])
    scale = reach / 2
    for _ in range(_FITS):
        rest = distance - terms @ warp
        weight = np.clip(1 - (rest / (3 * scale)) ** 2, 0, None) ** 2
        weighted = terms * weight[:, None]
        # A trace of the identity keeps the warp flat where a thin strip says nothing about it.
        warp = np.linalg.solve(weighted.T @ terms + 1e-3 * len(points) * np.eye(len(warp)), weighted.T @ distance)
        rest = distance - terms @ warp
        inlier = np.abs(rest) < 3 * scale
        scale = max(1e-3, 1.4826 * float(np.median(np.abs(rest[inlier]))))
    return Sheet(plane, axes, middle, np.append(warp, np.zeros(6 - len(warp))), scale)


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
    sheets = []
    pairs = near_pairs(coarse)
    for item in planes:
        lasting = item.removed_share >= _LASTING_SHARE
        sheet = fit_sheet(item.plane, coarse.centre, coarse.normal, _REACH, warped=lasting)
        if sheet is None or sheet.spread > _REACH / 3:
            continue  # no denser there than anywhere: the plane is gone, or never was one
        thickness = float(np.clip(_SPREADS * sheet.spread, settings.plane_distance, 2 * settings.plane_distance))
        cells = np.abs(sheet.distance(coarse.centre)) < thickness + coarse.edge / 2
        facing = cells & (coarse.normal @ sheet.plane[:3].astype(np.float32) > _FACING)
        if not lasting:
            facing = _reaching(coarse, pairs, facing, settings.size_max)
        near = _with_neighbours(pairs, facing)
        cells &= near if lasting else facing
        if cells.any():
            sheets.append(StructureSheet(sheet, thickness, cells, near))
    return sheets


def on_sheets(surface: Surface, coarse_cell: NDArray[np.int32], sheets: list[StructureSheet]) -> NDArray[np.bool_]:
    """Which cells lie on a sheet: within its thickness, facing its way unless very near, where it reaches.

    What goes down from its rim is the side of the board that it is the top of.
    coarse_cell: (n,) the coarse cell that holds each cell of the surface. Returns (n,) bool.
    """
    structure = np.zeros(len(surface.centre), np.bool_)
    for item in sheets:
        rows = np.flatnonzero((item.cells | item.near)[coarse_cell] & ~structure)
        signed = item.sheet.distance(surface.centre[rows])
        distance = np.abs(signed)
        facing = surface.normal[rows] @ item.sheet.plane[:3].astype(np.float32) > _FACING
        on = (distance < item.thickness) & (facing | (distance < item.thickness / 2))
        side = (signed < 0) & (signed > -_BOARD)
        structure[rows] = item.cells[coarse_cell[rows]] & on | item.near[coarse_cell[rows]] & side
    return structure


def lying_flat(surface: Surface, levels: list[Sheet]) -> NDArray[np.bool_]:
    """Cells of the tops of thin flat things: facing as a level sheet and a few centimetres above it. (n,) bool"""
    flat = np.zeros(len(surface.centre), np.bool_)
    for item in levels:
        rows = np.flatnonzero(surface.normal @ item.plane[:3].astype(np.float32) > _FLAT_FACING)
        height = item.distance(surface.centre[rows])
        flat[rows] |= (height > 0) & (height < _FLAT_HEIGHT)
    return flat


def _with_neighbours(pairs: NDArray[np.int32], member: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The members and the cells near them. (n,) bool"""
    near = member.copy()
    near[pairs[member[pairs[:, 0]], 1]] = True
    near[pairs[member[pairs[:, 1]], 0]] = True
    return near


def _reaching(surface: Surface, pairs: NDArray[np.int32], member: NDArray[np.bool_], reach: float) -> NDArray[np.bool_]:
    """The members whose connected component is longer than `reach`."""
    rows = np.flatnonzero(member)
    labels = connected_cells(pairs, member)
    count = int(labels.max(initial=-1)) + 1
    low = np.full((count, 3), np.inf, np.float32)
    high = np.full((count, 3), -np.inf, np.float32)
    np.minimum.at(low, labels[rows], surface.centre[rows])
    np.maximum.at(high, labels[rows], surface.centre[rows])
    large = np.append(np.linalg.norm(high - low, axis=1) > reach, False)
    return large[labels]


def _terms(
    points: NDArray[np.float32] | NDArray[np.float64], axes: NDArray[np.float64], middle: NDArray[np.float64]
) -> NDArray[np.float64]:
    x, y = np.clip((points - middle) @ axes.T, -1, 1).T
    return np.stack((np.ones_like(x), x, y, x * x, x * y, y * y), axis=1)


def _in_plane_axes(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    first /= np.linalg.norm(first)
    return np.stack((first, np.cross(normal, first)))
