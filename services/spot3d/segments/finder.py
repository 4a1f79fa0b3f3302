"""The objects of a single frame as segments of its lattice (paper, Sec. V-A, RGBD scenes)."""

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.frame_segments import FrameSegments
from spot3d.fusion.settings import FusionSettings
from spot3d.geometry.lattice import to_lattice
from spot3d.segments.settings import SegmentsSettings
from spot3d.segments.single_frame import find_in_frame
from spot3d_schemas.limits import MAX_SEGMENTS

_SHARED = ("plane_distance", "plane_triples", "plane_candidates", "noise_gate", "range_max", "heat_min", "seed")
"""Settings of fusion's surfaces that single frames have too."""


def find_segments(
    colour: NDArray[np.uint8],
    depth: NDArray[np.float32],
    heat: NDArray[np.uint8],
    camera: Intrinsics,
    settings: SegmentsSettings,
) -> FrameSegments:
    """The objects of one frame, on its lattice of about `lattice_width` samples across.

    colour: (h, w, 3) uint8 RGB; depth: (h, w) float32 metres, 0 = invalid; heat: (h, w) uint8, 255ths; camera: theirs.
    Every segment stands on the supporting plane; without one there are none.
    """
    frame = to_lattice(colour, depth, heat, camera, settings.lattice_width)
    surfaces = FusionSettings(**{name: getattr(settings, name) for name in _SHARED})
    found = find_in_frame(frame.colour, frame.depth, frame.heat, frame.camera, surfaces)
    count = min(len(found.boxes), MAX_SEGMENTS)
    labels = np.where(found.labels <= count, found.labels, 0).astype(np.uint8)
    warmth = np.bincount(labels.ravel(), frame.heat.ravel(), count + 1)[1:]
    size = np.bincount(labels.ravel(), minlength=count + 1)[1:]
    planes = np.zeros((0, 4)) if found.support is None else found.support[None]
    return FrameSegments(
        labels,
        (warmth / (255 * np.maximum(size, 1))).astype(np.float32),
        planes,
        np.full(count, len(planes) - 1, np.int8),
        frame.camera,
    )
