"""By how much poses turn out to be off, once later frames are known: keyframes' poses are adjusted along the way."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class PoseCorrections:
    """What the poses of earlier frames lack, by what is known with the latest one.

    stamps_ns: (k,) int64, rising, of the frames adjusted, k > 0; twists: (k, 6) float64, world axes: the shift of the
    camera, metres, and its rotation about itself, radians, from its pose as that was published at the time.
    """

    stamps_ns: NDArray[np.int64]
    twists: NDArray[np.float64]

    def at(self, stamp_ns: int) -> NDArray[np.float64] | None:
        """The twist (6,) of a frame, in line between those adjusted, and after the last one as its; None: it is from
        before the first one, whose corrections tell nothing of it."""
        if stamp_ns < self.stamps_ns[0]:
            return None
        # From the first stamp on, as an exact number: nanoseconds since 1970 are more than a float holds.
        since = (self.stamps_ns - self.stamps_ns[0]).astype(np.float64)
        elapsed = float(stamp_ns - int(self.stamps_ns[0]))
        return np.array([np.interp(elapsed, since, column) for column in self.twists.T])

    def seen_from(self, rotation: NDArray[np.float64]) -> Self:
        """The same in the axes of a frame that this (3, 3) rotation takes into the world."""
        parts = self.twists.reshape(-1, 2, 3) @ rotation
        return type(self)(self.stamps_ns, parts.reshape(-1, 6))
