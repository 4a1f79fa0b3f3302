"""The camera's picture with the boxes in it, and heat as an overlay."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D
from spot3d.camera import Intrinsics
from spot3d.dashboard.points import heat_colours
from spot3d.drawing.box_views import draw_view
from spot3d.frame import RgbdFrame
from spot3d_schemas import Object3D, Preview

WIDTH = 640
_HEAT_SHARE = 0.6
"""Opacity of the heat overlay where it is hottest."""


def live_picture(
    seen: Preview, heat: Preview | None, T_world_camera: NDArray[np.float64] | None, objects: Sequence[Object3D]
) -> NDArray[np.uint8]:
    """A preview at 640 pixels with each object's box and number; (h, 640, 3) uint8 RGB.

    heat: of the same frame or one near it; None: no overlay. T_world_camera: (4, 4) pose of the frame; None: unknown,
    no box is drawn.
    """
    colour = seen.colour if heat is None else with_heat(seen.colour, heat.colour[:, :, 0])
    if T_world_camera is None:
        return draw_view(_frame(seen, colour), np.eye(4), (), WIDTH)
    boxes = [(item.id, Box3D(item.centre, item.size, item.rotation)) for item in objects]
    return draw_view(_frame(seen, colour), T_world_camera, boxes, WIDTH)


def with_heat(colour: NDArray[np.uint8], heat: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Colour (h, w, 3) uint8 RGB with an overlay of heat, (h', w') uint8, which is transparent where heat is 0."""
    height, width = colour.shape[:2]
    heat = np.asarray(cv2.resize(heat, (width, height), interpolation=cv2.INTER_LINEAR), np.uint8)
    share = (np.float32(_HEAT_SHARE / 255) * heat)[:, :, None]
    mixed = colour * (1 - share) + heat_colours(heat.ravel()).reshape(height, width, 3) * share
    return np.asarray(mixed, np.uint8)


def _frame(seen: Preview, colour: NDArray[np.uint8]) -> RgbdFrame:
    camera = Intrinsics(**seen.intrinsics.model_dump())
    return RgbdFrame(seen.header.stamp_ns, colour, np.zeros(camera.shape, np.uint16), 1.0, camera)
