"""Registers colour to the depth camera's pixels, so that poses and intrinsics stay the depth camera's."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.geometry.inverse_depth import fill_inverse_depth
from spot3d.kernel import kernel
from spot3d.source.calibration import ColourCamera
from spot3d.source.errors import SourceError

# A nearer surface hides a point from the colour camera only if their parallax is at least this, at the colour camera's
# focal length: less than a pixel of parallax cannot be seen, whatever the range.
HIDDEN_PARALLAX_PX = 1.0


class ColourRegistration:
    """Registers colour images to depth images, for one pair of cameras. Keeps work arrays, but no frames."""

    def __init__(self, intrinsics: Intrinsics, camera: ColourCamera) -> None:
        self.intrinsics = intrinsics
        self.camera = camera
        depth_pinhole, colour_pinhole = (
            np.array((one.fx, one.fy, one.cx, one.cy), np.float32) for one in (intrinsics, camera.intrinsics)
        )
        self._pinholes = depth_pinhole, colour_pinhole
        self._T_colour_depth = np.ascontiguousarray(camera.T_colour_depth[:3], np.float32)
        baseline = float(np.linalg.norm(camera.T_colour_depth[:3, 3]))
        parallax_m = camera.intrinsics.fx * baseline
        self._hidden = np.float32(HIDDEN_PARALLAX_PX / parallax_m if parallax_m > 0 else np.inf)
        # A cell of the depth buffer is 2^bits colour pixels wide, at least as coarse as a depth pixel in colour, so
        # that the buffer has no gaps.
        self._cell_bits = max(0, math.ceil(math.log2(camera.intrinsics.fx / intrinsics.fx)))
        rows, self._cell_columns = ((side >> self._cell_bits) + 1 for side in camera.intrinsics.shape)
        # Kept: fresh memory pages for every frame would take as long as the computation.
        self._nearest = np.zeros(rows * self._cell_columns, np.float32)
        self._inverse, self._inverse_there, self._column, self._row = np.empty((4, *intrinsics.shape), np.float32)
        self._cell = np.empty(intrinsics.shape, np.uint32)
        self._is_hidden = np.empty(intrinsics.shape, np.bool_)
        # Coordinates in 32nds of a pixel are fine enough, and the look-up takes two thirds of the time.
        self._pixel, self._fraction = np.empty((*intrinsics.shape, 2), np.int16), np.empty(intrinsics.shape, np.uint16)

    def register(self, colour: NDArray[np.uint8], depth: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Colour image of the depth camera: each depth pixel's 3D point looked up in the colour camera.

        colour: (hc, wc, 3) uint8; depth: (h, w) float32 metres, 0 = invalid. Returns (h, w, 3) uint8 without holes. A
        pixel without depth takes the farther of its row's nearest valid depths, since most such pixels lie behind an
        edge. A point that a nearer surface hides takes the colour of its own surface beside it. Raises SourceError if
        an image's size is not that of its intrinsics.
        """
        shape = self.camera.intrinsics.shape
        if colour.shape != (*shape, 3) or depth.shape != self.intrinsics.shape:
            raise SourceError(
                f"size mismatch: colour {colour.shape} and depth {depth.shape}, but the intrinsics are for "
                f"{shape} and {self.intrinsics.shape}"
            )
        depth = np.ascontiguousarray(depth, np.float32)
        fill_inverse_depth(depth, self._inverse)
        projected = self._inverse_there, self._column, self._row
        _project(self._inverse, *self._pinholes, self._T_colour_depth, shape, *projected)
        _cells(self._column, self._row, self._cell_bits, self._cell_columns, self._cell)
        _find_hidden(depth, self._inverse_there, self._cell, self._hidden, self._nearest, self._is_hidden)
        cv2.convertMaps(self._column, self._row, cv2.CV_16SC2, self._pixel, self._fraction)
        image = cv2.remap(colour, self._pixel, self._fraction, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        registered = np.asarray(image, np.uint8)
        _fill_hidden(registered, self._inverse, self._is_hidden)
        return registered


@kernel()
def _project(
    inverse: NDArray[np.float32],
    depth_camera: NDArray[np.float32],
    colour_camera: NDArray[np.float32],
    T_colour_depth: NDArray[np.float32],
    colour_shape: tuple[int, int],
    inverse_there: NDArray[np.float32],
    column_of: NDArray[np.float32],
    row_of: NDArray[np.float32],
) -> None:
    """Writes each depth pixel's column and row in the colour image, clipped to it, and its inverse depth there."""
    h, w = inverse.shape
    T = T_colour_depth
    fx, fy, cx, cy = colour_camera
    zero, one, least = np.float32(0), np.float32(1), np.float32(1e-6)
    last_row, last_column = np.float32(colour_shape[0] - 1), np.float32(colour_shape[1] - 1)
    x = ((np.arange(w) - depth_camera[2]) / depth_camera[0]).astype(np.float32)
    ray_x, ray_y, ray_z = T[0, 0] * x, T[1, 0] * x, T[2, 0] * x
    for v in range(h):
        y = (np.float32(v) - depth_camera[3]) / depth_camera[1]
        row_x, row_y, row_z = T[0, 1] * y + T[0, 2], T[1, 1] * y + T[1, 2], T[2, 1] * y + T[2, 2]
        # No branches, so that the compiler vectorises this loop.
        for u in range(w):
            # The point times its inverse depth: finite also for points at infinity (q = 0).
            q = inverse[v, u]
            z = ray_z[u] + row_z + T[2, 3] * q
            scale = one / (z if z > least else least)
            uc = fx * (ray_x[u] + row_x + T[0, 3] * q) * scale + cx
            vc = fy * (ray_y[u] + row_y + T[1, 3] * q) * scale + cy
            uc = uc if uc > zero else zero  # also where it is NaN
            vc = vc if vc > zero else zero
            column_of[v, u] = last_column if uc > last_column else uc
            row_of[v, u] = last_row if vc > last_row else vc
            inverse_there[v, u] = q * scale


@kernel()
def _cells(
    column_of: NDArray[np.float32], row_of: NDArray[np.float32], bits: int, columns: int, cell: NDArray[np.uint32]
) -> None:
    """Writes the index of each depth pixel's cell in the depth buffer, which has `columns` cells in a row."""
    h, w = cell.shape
    half = np.float32(0.5)
    for v in range(h):
        for u in range(w):
            cell[v, u] = (np.int32(row_of[v, u] + half) >> bits) * columns + (np.int32(column_of[v, u] + half) >> bits)


@kernel()
def _find_hidden(
    depth: NDArray[np.float32],
    inverse_there: NDArray[np.float32],
    cell: NDArray[np.uint32],
    hidden: np.float32,
    nearest: NDArray[np.float32],
    is_hidden: NDArray[np.bool_],
) -> None:
    """Writes whether a measured point in the same cell is nearer to the colour camera by more than `hidden` 1/m."""
    h, w = depth.shape
    nearest[:] = 0
    for v in range(h):
        for u in range(w):  # without branches, which would be mispredicted
            there = inverse_there[v, u] if depth[v, u] > 0 else np.float32(0)
            before = nearest[cell[v, u]]
            nearest[cell[v, u]] = there if there > before else before
    for v in range(h):
        for u in range(w):
            is_hidden[v, u] = nearest[cell[v, u]] - inverse_there[v, u] > hidden


@kernel()
def _fill_hidden(image: NDArray[np.uint8], inverse: NDArray[np.float32], hidden: NDArray[np.bool_]) -> None:
    """Copies to hidden pixels of `image` (h, w, 3) the visible row neighbour of most similar depth, in place."""
    h, w = inverse.shape
    for v in range(h):
        start = 0
        left = -1
        for u in range(w):
            if hidden[v, u]:
                continue
            for hole in range(start, u):
                own = inverse[v, hole]
                similar = left >= 0 and abs(inverse[v, left] - own) <= abs(inverse[v, u] - own)
                beside = left if similar else u
                for channel in range(3):
                    image[v, hole, channel] = image[v, beside, channel]
            start = u + 1
            left = u
        for hole in range(start, w):
            # A row without visible pixels copies the row above it.
            for channel in range(3):
                image[v, hole, channel] = image[v, left, channel] if left >= 0 else image[max(v - 1, 0), hole, channel]
