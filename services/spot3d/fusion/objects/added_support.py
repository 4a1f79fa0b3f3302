"""Supports of segments whose segmenter gives none: a learned segmenter knows masks, and no planes."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import back_project
from spot3d.fusion.objects.found import STANDS
from spot3d.fusion.objects.keyframes import Keyframe
from spot3d.geometry.standing import stands_on


def with_support(keyframe: Keyframe, plane: NDArray[np.float64]) -> Keyframe:
    """The keyframe with one plane, (4,) camera frame, facing the camera, as the support of what stands on it."""
    points = back_project(keyframe.depth, keyframe.camera)
    height = points @ plane[:3] + plane[3]
    labels = np.where(keyframe.depth > 0, keyframe.labels, 0).ravel()
    parts = (np.flatnonzero(labels == number + 1) for number in range(len(keyframe.heat)))
    stand = [stands_on(pixels, height, points, plane[:3], STANDS) for pixels in parts]
    return replace(keyframe, planes=plane[None], stands_on=np.where(stand, 0, -1).astype(np.int8))
