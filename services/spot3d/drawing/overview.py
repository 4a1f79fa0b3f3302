"""The overview picture of a run: three views with boxes, the scene from above, a list of the objects."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.drawing.box_views import choose_views, draw_view, visibility
from spot3d.drawing.picture import GREY, WHITE, Picture, draw_text, object_colour
from spot3d.drawing.top_view import draw_top_view
from spot3d.found_object import FoundObject
from spot3d.frame import RgbdFrame

_WIDTH, _GAP, _TITLE_HEIGHT = 1600, 10, 46
_VIEW_WIDTH = (_WIDTH - 4 * _GAP) // 3
_TOP_SIZE = (2 * _VIEW_WIDTH + _GAP, 700)
_PAPER = (18, 20, 24)
_CANDIDATES = 40
"""Most views that are compared to choose three."""


def draw_overview(
    title: str,
    views: Sequence[tuple[RgbdFrame, NDArray[np.float64]]],
    objects: Sequence[FoundObject],
    xyz: NDArray[np.float32],
    rgb: NDArray[np.uint8],
    path: NDArray[np.float64],
    up: NDArray[np.float64],
) -> Picture:
    """The picture, (h, 1600, 3) uint8 RGB.

    views: candidate frames with their T_world_camera, in the order of the recording; three are shown.
    xyz, rgb: (n, 3) points of the map, world metres, and their colours. path: (m, 3) camera positions, world;
    up: (3,) unit.
    """
    boxes = [(item.id, item.box) for item in objects]
    panels = [draw_view(frame, pose, boxes, _VIEW_WIDTH) for frame, pose in best_views(views, objects)]
    view_height = max((panel.shape[0] for panel in panels), default=0)
    top = _TITLE_HEIGHT + view_height + (2 * _GAP if panels else _GAP)
    picture: Picture = np.full((top + _TOP_SIZE[1] + _GAP, _WIDTH, 3), _PAPER, np.uint8)
    draw_text(picture, title, (_GAP + 4, 31), WHITE, 0.75)
    for column, panel in enumerate(panels):
        left = _GAP + column * (_VIEW_WIDTH + _GAP)
        picture[_TITLE_HEIGHT + _GAP // 2 :][: panel.shape[0], left : left + _VIEW_WIDTH] = panel
    plan = draw_top_view(xyz, rgb, boxes, path, up, _TOP_SIZE)
    picture[top:, _GAP:][: plan.shape[0], : plan.shape[1]] = plan
    draw_text(picture, "from above", (_GAP + 14, top + 28), WHITE, 0.6, tag=True)
    _draw_list(picture, objects, _GAP + _TOP_SIZE[0] + 2 * _GAP, top)
    return picture


def candidate_indices(count: int) -> list[int]:
    """Evenly spaced indices of at most 40 out of `count` frames."""
    return sorted({int(index) for index in np.linspace(0, count - 1, min(count, _CANDIDATES))})


def best_views(
    views: Sequence[tuple[RgbdFrame, NDArray[np.float64]]], objects: Sequence[FoundObject]
) -> list[tuple[RgbdFrame, NDArray[np.float64]]]:
    """The three views that together show the objects best."""
    if not views:
        return []
    boxes = [item.box for item in objects]
    rows = [visibility(boxes, pose, frame.intrinsics, frame.depth_metres()) for frame, pose in views]
    return [views[index] for index in choose_views(np.array(rows).reshape(len(views), len(boxes)), 3)]


def _draw_list(picture: Picture, objects: Sequence[FoundObject], left: int, top: int) -> None:
    """One line per object: colour, id, size, views, confidence; as many as there is room for."""
    columns = (0, 70, 270, 375)
    for column, text in zip(columns, ("id", "size, cm", "views", "confidence"), strict=True):
        draw_text(picture, text, (left + column, top + 28), GREY, 0.5)
    room = (_TOP_SIZE[1] - 60) // 30
    shown = objects if len(objects) <= room else objects[: room - 1]
    y = top + 62
    for item in shown:
        colour = object_colour(item.id)
        cv2.rectangle(picture, (left, y - 13), (left + 15, y + 2), colour, -1)
        draw_text(picture, str(item.id), (left + 24, y), colour, 0.6)
        # Length, width, height: the third axis of an upright box is its height.
        first, second, third = (f"{100 * side:.0f}" for side in item.box.size)
        draw_text(picture, f"{first} x {second} x {third}", (left + columns[1], y), WHITE, 0.55)
        draw_text(picture, f"{item.views}", (left + columns[2], y), WHITE, 0.55)
        bar = round(120 * min(1.0, item.confidence))
        cv2.rectangle(picture, (left + columns[3], y - 11), (left + columns[3] + 120, y), (52, 56, 64), -1)
        cv2.rectangle(picture, (left + columns[3], y - 11), (left + columns[3] + bar, y), colour, -1)
        y += 30
    if len(shown) < len(objects):
        draw_text(picture, f"and {len(objects) - len(shown)} more", (left, y), GREY, 0.55)
    if not objects:
        draw_text(picture, "no objects", (left, y), GREY, 0.6)
