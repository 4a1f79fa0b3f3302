"""The scene from above: points in their colours, boxes as footprints, the camera's path, a scale bar."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D, corners
from spot3d.camera_pose import REACH_M
from spot3d.drawing.picture import GREY, INK, WHITE, Picture, draw_lines, draw_object_labels, draw_text, object_colour

_MARGIN = 0.25
"""Margin around boxes and camera path, metres."""
_HEADROOM = 0.10
"""Points higher than this above the highest box are cut off, as in a floor plan, metres."""
_CELL = 0.008
"""Points are drawn as squares of at least this size, metres."""
_BACKGROUND = (30, 33, 39)
_PATH = (255, 255, 255)


@dataclass(frozen=True, slots=True)
class _Plan:
    """The map from the world to pixels. R_plan_world: (3, 3), z up; low: (2,) metres; scale: pixels per metre."""

    R_plan_world: NDArray[np.float64]
    low: NDArray[np.float64]
    scale: float
    height: int

    def pixels(self, world: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 2) pixels of (n, 3) world points; the plan's y axis points up in the picture."""
        flat = (world @ self.R_plan_world.T)[:, :2] - self.low
        return np.column_stack((flat[:, 0], -flat[:, 1])) * self.scale + (0, self.height)


def draw_top_view(
    xyz: NDArray[np.float32],
    rgb: NDArray[np.uint8],
    boxes: Sequence[tuple[int, Box3D]],
    path: NDArray[np.float64],
    up: NDArray[np.float64],
    size: tuple[int, int],
) -> Picture:
    """A picture of `size` (width, height), uint8 RGB, seen from above, against `up` (3,).

    xyz: (n, 3) map points, world, metres, with rgb: (n, 3); boxes: (id, box); path: (m, 3) camera positions, of which
    those more than 2 km away are left out.
    """
    width, height = size
    path = path[np.abs(path).max(axis=1) < REACH_M]  # fusion uses none beyond
    picture: Picture = np.full((height, width, 3), _BACKGROUND, np.uint8)
    outlines = [corners(box) for _, box in boxes]
    shown = np.vstack([*outlines, path, np.zeros((0, 3))])
    if len(shown) == 0:
        shown = xyz.astype(np.float64)
    if len(shown) == 0:
        draw_text(picture, "nothing was fused", (20, 40), GREY, 0.7)
        return picture
    plan = _fitted(shown, up, size)
    ceiling = max((float((outline @ up).max()) + _HEADROOM for outline in outlines), default=np.inf)
    _draw_points(picture, plan, xyz[xyz @ up < ceiling], rgb[xyz @ up < ceiling])
    _draw_path(picture, plan, path)
    labels = []
    for (number, box), outline in zip(boxes, outlines, strict=True):
        pixels = plan.pixels(outline).astype(np.float32)
        hull = cv2.convexHull(pixels)[:, 0].astype(np.float64)
        draw_lines(picture, np.stack((hull, np.roll(hull, -1, axis=0)), axis=1), object_colour(number), 2)
        centre = plan.pixels(box.centre[None])[0]
        labels.append((number, (float(centre[0]), float(centre[1]) + 7)))
    draw_object_labels(picture, labels)
    _draw_scale_bar(picture, plan.scale)
    return picture


def _fitted(shown: NDArray[np.float64], up: NDArray[np.float64], size: tuple[int, int]) -> _Plan:
    """A plan that fits the shown points, turned so that their long side lies along the picture's width."""
    first = np.linalg.svd(up[None])[2][1]
    level = np.stack((first, np.cross(up, first)))
    flat = shown @ level.T
    hull = cv2.convexHull(flat.astype(np.float32))
    (_, _), (width, height), degrees = cv2.minAreaRect(hull)
    angle = np.radians(degrees + (90 if height > width else 0))
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    R_plan_world = np.vstack((turn @ level, up))
    flat = (shown @ R_plan_world.T)[:, :2]
    extent = np.maximum(np.ptp(flat, axis=0) + 2 * _MARGIN, 0.5)
    scale = float(min(np.array(size) / extent))
    low = (flat.min(axis=0) + flat.max(axis=0)) / 2 - np.array(size) / scale / 2
    return _Plan(R_plan_world, low, scale, size[1])


def _draw_points(picture: Picture, plan: _Plan, xyz: NDArray[np.float32], rgb: NDArray[np.uint8]) -> None:
    """Paint points from low to high, on a coarser grid where one pixel is finer than the map."""
    coarse = max(1.0, _CELL * plan.scale)
    shape = (int(np.ceil(picture.shape[0] / coarse)), int(np.ceil(picture.shape[1] / coarse)))
    cells = np.floor(plan.pixels(xyz.astype(np.float64)) / coarse).astype(np.int64)
    inside = ((cells >= 0) & (cells < (shape[1], shape[0]))).all(axis=1)
    cells, xyz, rgb = cells[inside], xyz[inside], rgb[inside]
    order = np.argsort(xyz @ plan.R_plan_world[2], kind="stable")
    grid: Picture = np.full((*shape, 3), _BACKGROUND, np.uint8)
    filled = np.zeros(shape, np.uint8)
    # NumPy does not define which of two writes to one cell stays; the last of each cell is chosen here.
    index = cells[order, 1] * shape[1] + cells[order, 0]
    last, position = np.unique(index[::-1], return_index=True)
    grid.reshape(-1, 3)[last] = rgb[order][::-1][position]
    filled.reshape(-1)[last] = 1
    kernel = np.ones((3, 3), np.uint8)
    spread = cv2.dilate(np.where(filled[..., None] > 0, grid, 0).astype(np.uint8), kernel)
    gaps = (filled == 0) & (cv2.dilate(filled, kernel) > 0)
    grid[gaps] = spread[gaps]
    # Single cells in which the floor shows through the table are noise of the map, not holes.
    grid = np.asarray(cv2.medianBlur(grid, 3), np.uint8)
    full = cv2.resize(grid, (round(shape[1] * coarse), round(shape[0] * coarse)), interpolation=cv2.INTER_LINEAR)
    painted = full[: picture.shape[0], : picture.shape[1]]
    # Darker than measured, so that boxes and labels stand out.
    picture[: painted.shape[0], : painted.shape[1]] = (painted * 0.85).astype(np.uint8)


def _draw_path(picture: Picture, plan: _Plan, path: NDArray[np.float64]) -> None:
    if len(path) == 0:
        return
    pixels = plan.pixels(path)
    draw_lines(picture, np.stack((pixels[:-1], pixels[1:]), axis=1), _PATH, 1)
    for at, text in ((pixels[0], "start"), (pixels[-1], "end")):
        cv2.circle(picture, (round(at[0]), round(at[1])), 6, INK, -1, cv2.LINE_AA)
        cv2.circle(picture, (round(at[0]), round(at[1])), 4, _PATH, -1, cv2.LINE_AA)
        draw_text(picture, text, (float(at[0]) + 9, float(at[1]) + 5), _PATH, 0.45, tag=True)


def _draw_scale_bar(picture: Picture, scale: float) -> None:
    """A bar of a round length, about a sixth of the picture's width, in the lower left corner."""
    wanted = picture.shape[1] / 6 / scale
    length = max((step for step in (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0) if step <= wanted), default=0.05)
    left, y, right = 20.0, picture.shape[0] - 20.0, 20.0 + length * scale
    ticks = [((left, y), (right, y)), ((left, y - 5), (left, y + 5)), ((right, y - 5), (right, y + 5))]
    draw_lines(picture, np.array(ticks), WHITE, 2)
    text = f"{length:g} m" if length >= 1 else f"{100 * length:g} cm"
    draw_text(picture, text, (left, y - 11), WHITE, 0.55, tag=True)
