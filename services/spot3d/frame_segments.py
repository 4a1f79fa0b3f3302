"""The objects of one single frame, as the segments stage hands them to fusion, where they vote."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from spot3d.calibration import Calibration, moved_planes, sheared
from spot3d.camera import Intrinsics
from spot3d_schemas.limits import MAX_PLANES, MAX_SEGMENTS

TOO_SMALL, TOO_LOW, TOO_LONG, TOO_COLD, TOO_MANY = (
    f"{how} in a keyframe" for how in ("too small", "too low", "too long", "too cold", "too many")
)
"""Why a part of a frame is no segment: it covers less than the least object; it hardly rises above its support; it is
longer than eps_max; it is colder than a segment may be; or larger ones already fill the message."""
BELOW_SUPPORT, NO_SUPPORT = "below the support in a keyframe", "without a support in a keyframe"
"""A part as large as an object rises nowhere above the support. A keyframe, counted as one, shows no plane on which
objects may stand."""
WITHOUT_DEPTH, SEVERAL, OTHER = (
    f"{how} in a keyframe" for how in ("without depth", "several objects in one", "for another reason")
)
"""Why a segment has no vote: it has too little depth for a shape; or most views divide it. And parts that a segmenter
leaves out for reasons of its own."""
KEYFRAME_REASONS = (
    *(TOO_SMALL, TOO_LOW, TOO_LONG, TOO_COLD, TOO_MANY),
    *(BELOW_SUPPORT, NO_SUPPORT, WITHOUT_DEPTH, SEVERAL, OTHER),
)
"""All of them."""


@dataclass(frozen=True, slots=True)
class FrameSegments:
    """Objects of one frame, validated once, here.

    labels: (h, w) uint8, 0 = no object, k = segment k - 1.
    heat: (n,) float32, mean confidence of each segment in [0, 1], n <= 255.
    planes: (p, 4) float64 [n_x, n_y, n_z, b], camera frame, metres, n.x + b = 0: the surfaces on which objects stand,
    the main one first, unit normals up (towards the camera's side), p <= 32.
    stands_on: (n,) int8, the row of `planes` on which each segment stands, -1 = unknown.
    camera: intrinsics of `labels`. left_out: number of parts that are no segments, by reason.
    """

    labels: NDArray[np.uint8]
    heat: NDArray[np.float32]
    planes: NDArray[np.float64]
    stands_on: NDArray[np.int8]
    camera: Intrinsics
    left_out: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _check("labels", self.labels, np.uint8, self.camera.shape)
        count, planes = len(self.heat), len(self.planes)
        if count > MAX_SEGMENTS or planes > MAX_PLANES:
            raise ValueError(
                f"{count} segments on {planes} planes exceed the limits of {MAX_SEGMENTS} and {MAX_PLANES}"
            )
        _check("heat", self.heat, np.float32, (count,))
        _check("planes", self.planes, np.float64, (planes, 4))
        _check("stands_on", self.stands_on, np.int8, (count,))
        if self.labels.max(initial=0) > count:
            raise ValueError(f"the largest label is {self.labels.max()}, but there are {count} segments")
        if not ((self.heat >= 0) & (self.heat <= 1)).all():
            raise ValueError("heat must be in [0, 1]")
        if not ((self.stands_on >= -1) & (self.stands_on < planes)).all():
            raise ValueError(f"stands_on must hold rows of the {planes} planes, or -1")

    def __len__(self) -> int:
        return len(self.heat)

    def boxes(self, camera: Intrinsics) -> NDArray[np.float64]:
        """(n, 4) float64 [x, y, w, h]: the boxes around the segments' pixels, in pixels of another camera's image.

        A pixel is a square from its number to the next one. Boxes end at the image's rim. Without pixels a box is 0.
        """
        own, found = self.camera, np.zeros((len(self), 4))
        for number in range(len(self)):
            v, u = np.nonzero(self.labels == number + 1)
            if len(u):
                corners = np.array(((u.min(), v.min()), (u.max() + 1, v.max() + 1))) - 0.5 - (own.cx, own.cy)
                scale = np.array((camera.fx / own.fx, camera.fy / own.fy))
                # A lattice's last sample stands for a whole block, of which the image may hold a part.
                low, high = np.clip(corners * scale + (camera.cx, camera.cy) + 0.5, 0, (camera.width, camera.height))
                found[number] = *low, *(high - low)
        return found

    def calibrated(self, calibration: Calibration) -> "FrameSegments":
        """The segments as this calibration would have seen them; its turn is part of the camera's pose."""
        moves = calibration.depth_factor * sheared(calibration.centre)
        planes = moved_planes(self.planes, moves, np.zeros(3))
        return replace(self, planes=planes, camera=calibration.camera(self.camera))

    def seen_by(self, camera: Intrinsics) -> "FrameSegments":
        """The segments on another lattice of the same view: each pixel takes the label of the nearest one here.

        Pixels outside this image have no object.
        """
        if camera == self.camera:
            return self
        own = self.camera
        u = np.rint((np.arange(camera.width) - camera.cx) * (own.fx / camera.fx) + own.cx).astype(np.int64)
        v = np.rint((np.arange(camera.height) - camera.cy) * (own.fy / camera.fy) + own.cy).astype(np.int64)
        labels = self.labels[np.ix_(np.clip(v, 0, own.height - 1), np.clip(u, 0, own.width - 1))]
        labels[(v < 0) | (v >= own.height), :] = 0
        labels[:, (u < 0) | (u >= own.width)] = 0
        return replace(self, labels=labels, camera=camera)


def _check(name: str, array: NDArray[np.generic], dtype: type[np.generic], shape: tuple[int, ...]) -> None:
    if array.dtype != dtype or array.shape != shape:
        raise ValueError(f"{name} is {array.dtype} {array.shape}; expected {np.dtype(dtype)} {shape}")
