"""How far a segment reaches that lacks part of its depth: a shiny or dark object.

Such an object has depth on its top, or on a label, and its outline in colour shows how far it continues. It stands on
its support: where the outline's lower side is seen it is down there, and from the pixels with depth to there its height
falls with the distance in the image.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.objects.keyframes import Keyframe

_TORN = 0.3
"""A segment is torn if this share of its pixels has no depth. An infrared projector's shadow, which an outline may take
in by mistake, is a tenth or so of the object that casts it. With 30 % of clutter's depth missing in other places in
each frame, IoU is 0.68 with 0.3, as without outlines, and 0.64 with 0.2."""
_AXES = np.array([(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1) if (i, j, k) != (0, 0, 0)])
OUTERMOST = len(_AXES)
"""An outline is the outermost points towards a cube's faces, edges and corners."""


def outline_of(keyframe: Keyframe, label: int) -> NDArray[np.float32]:
    """The outermost points of a torn segment where it has no depth, (OUTERMOST, 3) camera frame, metres.

    label: of the segment. NaN if it is not torn, or stands on no known plane.
    """
    nothing = np.full((OUTERMOST, 3), np.nan, np.float32)
    x, y, w, h = cv2.boundingRect((keyframe.labels == label).astype(np.uint8))
    part = np.s_[y : y + h, x : x + w]
    own, depth = keyframe.labels[part] == label, keyframe.depth[part]
    known, torn = own & (depth > 0), own & (depth <= 0)
    if not len(keyframe.planes) or not known.any() or np.count_nonzero(torn) < _TORN * np.count_nonzero(own):
        return nothing
    camera, stands_on = keyframe.camera, keyframe.stands_on[label - 1]
    plane = keyframe.planes[max(0, stands_on)]
    normal, offset = plane[:3], plane[3]
    v, u = np.indices(own.shape)
    rays = np.stack(((u + x - camera.cx) / camera.fx, (v + y - camera.cy) / camera.fy, np.ones(own.shape)), axis=2)
    middle = rays[own].mean(axis=0)
    # Where each ray meets the support, and where it is as far ahead as the pixels with depth reach.
    with np.errstate(divide="ignore"):
        bottom = np.where(rays @ normal < 0, -offset / (rays @ normal), np.inf)
        ahead = rays @ (middle - (middle @ normal) * normal)
        behind = np.where(ahead > 0, (depth * ahead)[known].max() / ahead, np.inf)
    height = _nearest(np.maximum(depth * (rays @ normal) + offset, 0), known)
    down = middle[:2] * normal[2] - normal[:2]
    across, along = np.rint(down / max(float(np.linalg.norm(down)), 1e-9)).astype(int)
    # Whether the next pixel down has no label; beyond the image's rim that is unknown.
    bare = np.pad(keyframe.labels == 0, 1)[y + along + 1 :, x + across + 1 :][:h, :w]
    foot = torn & bare & (bottom <= behind)
    if stands_on < 0 and not foot.any():
        return nothing
    if foot.any():
        to_foot, to_known = (cv2.distanceTransform((~of).astype(np.uint8), cv2.DIST_L2, 5) for of in (foot, known))
        height *= to_foot / (to_foot + to_known)
    with np.errstate(divide="ignore", invalid="ignore"):
        deep = np.minimum((height - offset) / (rays @ normal), behind)
    guessed = torn & (deep > 0) & np.isfinite(deep)
    if not guessed.any():
        return nothing
    points = rays[guessed] * deep[guessed][:, None]
    return np.asarray(points[np.argmax(points @ _AXES.T, axis=0)], np.float32)


def _nearest(values: NDArray[np.float64], known: NDArray[np.bool_]) -> NDArray[np.float64]:
    """For each pixel, the value of the nearest known one."""
    _, number = cv2.distanceTransformWithLabels(
        (~known).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    of = np.zeros(int(number.max()) + 1)
    of[number[known]] = values[known]
    return np.asarray(of[number])
