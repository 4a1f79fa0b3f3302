"""Corrections of earlier poses, known once later frames are: keyframes' poses are adjusted along the way."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class PoseCorrections:
    """Corrections of earlier frames' poses, as known with the latest frame.

    stamps_ns: (k,) int64, ascending, of the frames adjusted, k > 0; twists: (k, 6) float64, world axes: the shift of
    the camera, metres, and its rotation about itself, radians, from its pose as that was published at the time.
    """

    stamps_ns: NDArray[np.int64]
    twists: NDArray[np.float64]

    def at(self, stamp_ns: int) -> NDArray[np.float64] | None:
        """The twist (6,) of a frame, linear between adjusted ones, then constant; None before the first.

        Corrections say nothing of frames before it.
        """
        if stamp_ns < self.stamps_ns[0]:
            return None
        # Relative to the first stamp, as an exact integer: a float cannot hold nanoseconds since 1970.
        since = (self.stamps_ns - self.stamps_ns[0]).astype(np.float64)
        elapsed = float(stamp_ns - int(self.stamps_ns[0]))
        return np.array([np.interp(elapsed, since, column) for column in self.twists.T])

    def seen_from(self, rotation: NDArray[np.float64]) -> Self:
        """The same corrections in the axes of a frame with this (3, 3) rotation into the world."""
        parts = self.twists.reshape(-1, 2, 3) @ rotation
        return type(self)(self.stamps_ns, parts.reshape(-1, 6))
