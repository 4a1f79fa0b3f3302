"""Small images of frames for dashboards, sent only while somebody subscribes."""

import time

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.dataflow.conversion import intrinsics_message
from spot3d.dataflow.node import Node
from spot3d_schemas import Header, Preview
from spot3d_schemas.limits import MAX_PREVIEW_PIXELS

_WIDTH = 320
_INTERVAL_S = 0.2
_QUALITY = 75
"""JPEG; 8 to 15 kB at 320 pixels."""


class Previews:
    """Sends small images of some frames: at most five a second, and only while somebody subscribes."""

    def __init__(self, node: Node, topic: str) -> None:
        self._node, self._topic = node, topic
        self._due_s = 0.0

    def offer(self, header: Header, image: NDArray[np.uint8], camera: Intrinsics) -> None:
        """Send this frame's image, (h, w, 3) RGB or (h, w), if one is due and wanted. header: the frame's."""
        now_s = time.monotonic()
        if now_s < self._due_s or not self._node.wanted(self._topic):
            return
        self._due_s = now_s + _INTERVAL_S
        small, small_camera = preview(image, camera)
        message = Preview(
            header=self._node.numbered(self._topic, header),
            intrinsics=intrinsics_message(small_camera),
            colour=small,
        )
        self._node.publish(self._topic, message, jpeg_quality=_QUALITY)


def preview(image: NDArray[np.uint8], camera: Intrinsics) -> tuple[NDArray[np.uint8], Intrinsics]:
    """The image as (h, w, 3) RGB, at most 320 pixels wide and as large as messages allow, with its intrinsics.

    image: (h, w, 3) RGB or (h, w), which becomes grey.
    """
    scale = min(1.0, _WIDTH / camera.width, (MAX_PREVIEW_PIXELS / (camera.width * camera.height)) ** 0.5)
    width, height = (max(1, int(scale * side + 1e-6)) for side in (camera.width, camera.height))
    if (height, width) != camera.shape:
        image = np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
    if image.ndim == 2:
        image = np.repeat(image[:, :, None], 3, axis=2)
    across, down = width / camera.width, height / camera.height
    # Pixel centres are at integer coordinates, so that the image begins at -0.5.
    centre = (camera.cx + 0.5) * across - 0.5, (camera.cy + 0.5) * down - 0.5
    return image, Intrinsics(camera.fx * across, camera.fy * down, *centre, width, height)
