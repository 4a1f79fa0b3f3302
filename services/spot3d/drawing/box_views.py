"""Boxes drawn into the camera's images, and the choice of the views that show most of them."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import CORNERS, EDGES, Box3D, corners
from spot3d.camera import Intrinsics, invert
from spot3d.drawing.picture import Picture, draw_faint_lines, draw_lines, draw_object_labels, object_colour
from spot3d.frame import RgbdFrame

_NEAR = 0.05
"""Edges are clipped nearer to the camera than this, metres."""
_TALLEST = 4
"""Greatest height of a view in its widths, so that of a column of pixels it is 5 MB and not 2 GB at a width of 640. No
camera's image is so narrow."""
_LARGE_ENOUGH = 60.0
"""Size in pixels (at an image width of 640) above which a larger object is not seen better."""


def visibility(
    boxes: Sequence[Box3D],
    T_world_camera: NDArray[np.float64],
    camera: Intrinsics,
    depth: NDArray[np.float32] | None = None,
) -> NDArray[np.float64]:
    """How well one view shows each box, (n,) in 0..1: wholly in the image, large enough, not occluded.

    depth: (h, w) float32 metres, 0 = invalid; without it nothing counts as occluded.
    """
    T_camera_world = invert(T_world_camera)
    scores = np.zeros(len(boxes))
    for row, box in enumerate(boxes):
        points = _moved(T_camera_world, np.vstack((box.centre, corners(box))))
        if points[:, 2].min() < _NEAR:
            continue
        pixels = _projected(points, camera)
        inside = np.all((pixels >= 0) & (pixels < (camera.width, camera.height)), axis=1)
        if not inside[0]:
            continue
        extent = float(np.ptp(pixels[1:], axis=0).max()) * 640 / camera.width
        u, v = pixels[0].astype(int)
        measured = 0.0 if depth is None else float(depth[v, u])
        covered = 0 < measured < points[1:, 2].min() - 0.05
        scores[row] = inside[1:].mean() * min(1.0, extent / _LARGE_ENOUGH) * (not covered)
    return scores


def choose_views(scores: NDArray[np.float64], count: int) -> list[int]:
    """Up to `count` views that together show the boxes best, in the order of the recording.

    scores: (views, boxes) in 0..1. Greedy: each next view adds most to the sum, over boxes, of the best
    score, plus a smaller one for each box shown again, which ranks views that add nothing else.
    """
    views, boxes = scores.shape
    best, total, chosen = np.zeros(boxes), np.zeros(boxes), list[int]()
    for _ in range(min(count, views)):
        gain = (np.maximum(scores, best) - best + 0.5 * scores / (1 + total)).sum(axis=1)
        # Views near in time show the same.
        for taken in chosen:
            gain *= np.minimum(1.0, 0.2 + np.abs(np.arange(views) - taken) * 3 / max(1, views))
        gain[chosen] = -1
        chosen.append(int(gain.argmax()))
        best, total = np.maximum(best, scores[chosen[-1]]), total + scores[chosen[-1]]
    return sorted(chosen)


def draw_view(
    frame: RgbdFrame, T_world_camera: NDArray[np.float64], boxes: Sequence[tuple[int, Box3D]], width: int
) -> Picture:
    """The frame's colour image at `width` pixels with every (id, box) as a wireframe with its id.

    Edges of the side that faces away are faint. An image over four times as high as wide is narrower than the picture,
    and black beside it. Returns (h, width, 3) uint8 RGB.
    """
    scale = min(width / frame.intrinsics.width, _TALLEST * width / frame.intrinsics.height)
    size = (max(1, round(frame.intrinsics.width * scale)), max(1, round(frame.intrinsics.height * scale)))
    image = cv2.resize(frame.colour, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)
    height = size[1]
    picture: Picture = np.zeros((height, width, 3), np.uint8)
    picture[:, : size[0]] = image
    T_camera_world = invert(T_world_camera)
    drawn = []
    for number, box in boxes:
        centre = _moved(T_camera_world, box.centre[None])[0]
        if centre[2] > _NEAR:
            drawn.append((float(centre[2]), number, box))
    labels = []
    for _, number, box in sorted(drawn, key=lambda item: -item[0]):
        points = _moved(T_camera_world, corners(box))
        front, back = _edges_by_side(box, T_world_camera[:3, 3])
        colour = object_colour(number)
        draw_faint_lines(picture, _segments(points, back, frame.intrinsics) * scale, colour)
        draw_lines(picture, _segments(points, front, frame.intrinsics) * scale, colour, 2)
        pixels = _projected(np.maximum(points, (-np.inf, -np.inf, _NEAR)), frame.intrinsics) * scale
        anchor = (float(pixels[:, 0].mean()), float(pixels[:, 1].min()) - 8)
        if 0 <= anchor[0] < width and -20 <= anchor[1] < height and pixels[:, 1].max() > 0:
            labels.append((number, anchor))
    draw_object_labels(picture, labels)
    return picture


def _moved(T_target_source: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    moved: NDArray[np.float64] = points @ T_target_source[:3, :3].T + T_target_source[:3, 3]
    return moved


def _projected(points: NDArray[np.float64], camera: Intrinsics) -> NDArray[np.float64]:
    pixels: NDArray[np.float64] = points[:, :2] / points[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    return pixels


def _edges_by_side(box: Box3D, eye: NDArray[np.float64]) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Edges of at least one face that faces the eye, and the others."""
    local = (eye - box.centre) @ box.rotation
    front: list[tuple[int, int]] = []
    back: list[tuple[int, int]] = []
    for a, b in EDGES.tolist():
        shared = CORNERS[a] == CORNERS[b]
        facing = (CORNERS[a] * local > box.size / 2)[shared].any()
        (front if facing else back).append((a, b))
    return front, back


def _segments(points: NDArray[np.float64], edges: list[tuple[int, int]], camera: Intrinsics) -> NDArray[np.float64]:
    """(n, 2, 2) pixel segments of the edges' parts in front of the camera. points: (8, 3), camera frame."""
    segments = []
    for a, b in edges:
        start, end = points[a], points[b]
        if max(start[2], end[2]) < _NEAR:
            continue
        if min(start[2], end[2]) < _NEAR:
            near, far = (start, end) if start[2] < end[2] else (end, start)
            start, end = near + (far - near) * (_NEAR - near[2]) / (far[2] - near[2]), far
        segments.append(_projected(np.stack((start, end)), camera))
    return np.array(segments).reshape(-1, 2, 2)
