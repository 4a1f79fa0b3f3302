"""Stamped poses, with interpolation between them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from spot3d.trajectory import pose_from_quaternion, quaternion_from_rotation

Pose = NDArray[np.float64]
_GAP_NS = 250_000_000
"""Poses are not interpolated over a longer gap: the tracker was lost, or the poses are of another time."""
CHECK_POSES = f"check that both use the same clock, and that poses are at most {_GAP_NS / 1e9:g} s apart"
"""What to do about images without a pose at their time."""


class Motion:
    """Stamped poses, with interpolation between them."""

    def __init__(self, stamped: Sequence[tuple[int, Pose]]) -> None:
        ordered = dict(sorted(stamped, key=lambda entry: entry[0]))
        self._stamps_ns = np.array(list(ordered), np.int64)
        self._poses = np.array(list(ordered.values())).reshape(-1, 4, 4)

    def __len__(self) -> int:
        return len(self._stamps_ns)

    def at(self, stamp_ns: int) -> Pose | None:
        """The pose at a time, interpolated. None outside of the stamps, or in a gap that is too long."""
        after = int(np.searchsorted(self._stamps_ns, stamp_ns))
        if after < len(self) and self._stamps_ns[after] == stamp_ns:
            return np.asarray(self._poses[after])
        if not 0 < after < len(self):
            return None
        start, end = int(self._stamps_ns[after - 1]), int(self._stamps_ns[after])
        if end - start > _GAP_NS:
            return None
        share = (stamp_ns - start) / (end - start)
        one, other = self._poses[after - 1], self._poses[after]
        p, q = quaternion_from_rotation(one[:3, :3]), quaternion_from_rotation(other[:3, :3])
        # Rotations within a quarter of a second are small: linear interpolation is close to the arc.
        between = (1 - share) * p + share * (q if p @ q >= 0 else -q)
        return pose_from_quaternion((1 - share) * one[:3, 3] + share * other[:3, 3], between)
