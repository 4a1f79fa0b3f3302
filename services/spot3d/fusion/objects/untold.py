"""What segments stand on where whoever found them does not say it: a learned segmenter knows masks, and no planes."""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.camera import back_project
from spot3d.fusion.objects.found import STANDS
from spot3d.fusion.objects.keyframes import Keyframe

_AROUND = np.ones((7, 7), np.uint8)
"""What is up to three pixels aside is around a segment: edges of depth wander by two, or have none."""
_LOWEST = 0.02
"""This share of a segment's points may lie below its bottom: noise, and pixels at its edge."""


def with_support(keyframe: Keyframe, plane: NDArray[np.float64]) -> Keyframe:
    """The keyframe with one plane, (4,) camera frame, which faces the camera; see `Keyframe.planes`.

    A segment stands on it that begins there, or around which most of what is seen lies there: from above a thing hides
    where it begins.
    """
    points = back_project(keyframe.depth, keyframe.camera)
    height, seen = points @ plane[:3] + plane[3], keyframe.depth > 0
    stands_on = np.full(len(keyframe.heat), -1, np.int8)
    for number in range(len(stands_on)):
        own = keyframe.labels == number + 1
        around = (cv2.dilate(own.astype(np.uint8), _AROUND) > 0) & ~own & seen
        own &= seen
        bottom = np.quantile(height[own], _LOWEST) if own.any() else np.inf
        beside = np.median(height[around]) if around.any() else np.inf
        if min(abs(bottom), abs(beside)) < STANDS:
            stands_on[number] = 0
    return replace(keyframe, planes=plane[None], stands_on=stands_on)
