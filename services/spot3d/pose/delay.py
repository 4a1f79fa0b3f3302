"""By how much the given poses are later than the images that they come with.

A tracker's clock is not the camera's, and both take their time: poses that are a few hundredths of a second old are a
centimetre off where the camera is carried at half a metre a second, each time to another side. Where the camera is
faster, registration to the map puts it further on than the poses say, in proportion: how the one changes with the
other, from frame to frame, tells the delay, which is sharpened from frame to frame (a Kalman filter of one state).
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from spot3d.pose.motion import extrapolated, twist

# The constants below, with half and with twice their value, find 64 to 71 of 67 ms in twelve seconds of a fast hand at
# rendered desks, 40 to 66 of 67 ms and 22 to 34 of 33 ms in 33 seconds of redkitchen, ten frames a second; poses in
# time, exact or shaken by 10 and 20 mm, are taken for 6 ms late at most. `_SMOOTH_S`, `_APART_S`, `_SURE` alone matter.
# A hand moves anew after a third of a second: where poses are further apart, they do not tell its velocity. With 0.2
# nothing is found at ten frames a second.
_SMOOTH_S = 1 / 3
# Velocities are compared over so long, seconds: as long as delays may be, and so long that they differ. With 0.06 and
# 0.1 as much is found; from 0.15 on shaken poses in time, which tremble as slowly, are taken for up to 40 ms late.
_APART_S = 0.12
# So many changes of velocity tell how much registrations scatter, before they tell anything else.
_FIRST = 10
# Changes of an offset that are larger than so many of its standard deviations are failed registrations.
_OUTLIER = 3.0
# No delay is better known than this, seconds: half of an exposure. The map was made with the delay as it was known
# before, and follows what the poses do: what is left over shows in the next frames.
_KNOWN_S = 0.004
# What lies within so many standard deviations may be chance: poses count as in time until they surely are not.
# With 1, shaken poses in time are taken for up to 20 ms late; with 3 less is found, and later.
_SURE = 2.0
# Steps smaller than this move a camera that is carried at half a metre a second by a millimetre.
_STEP_S = 0.002
# More than so many standard deviations no tracker is late.
_MOST = 5.0
TOLD_S = 0.01
"""A delay of less is not spoken of."""


def told(delay_s: float) -> str:
    """What is wrong with the given poses, in words; empty where that is not worth a word."""
    if abs(delay_s) < TOLD_S:
        return ""
    side = "older" if delay_s > 0 else "newer"
    return f"given poses are {1e3 * abs(delay_s):.0f} ms {side} than their images, and are corrected: check the stamps"


class PoseDelay:
    """The delay of the given poses, and where the camera is by them.

    sigma: of the delay, standard deviation in seconds; 0: poses are taken as they are.
    """

    def __init__(self, sigma: float) -> None:
        self.delay_s = 0.0
        self._sigma = sigma
        self._information = sigma**-2 if sigma else np.inf
        self._estimate = 0.0
        self._last: tuple[float, NDArray[np.float64]] | None = None
        # Some of the frames: seconds, given pose, offset of the registered one from the compensated one.
        self._frames: deque[tuple[float, NDArray[np.float64], NDArray[np.float64]]] = deque(maxlen=4)
        self._scatter = np.zeros(2)
        self._count = 0

    def compensated(self, stamp_ns: int, T_world_given: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where the camera is at the time of the image, if the given pose is as late as is known by now."""
        time_s = 1e-9 * stamp_ns
        before, self._last = self._last, (time_s, T_world_given)
        if self.delay_s == 0 or before is None or not 0 < time_s - before[0] <= _SMOOTH_S:
            return T_world_given
        return extrapolated(before[1], T_world_given, self.delay_s / (time_s - before[0]))

    def learn(self, offset: NDArray[np.float64], sigma: NDArray[np.float64]) -> None:
        """Take the registration of the frame last compensated into account.

        offset: (6,) twist from its compensated pose to the registered one, world axes; sigma: (6,) the stated
        uncertainty of given poses, in units of which offsets count.
        """
        if not self._sigma or self._last is None:
            return
        time_s, T_world_given = self._last
        if self._frames and 0 < time_s - self._frames[-1][0] < _APART_S:
            return
        self._frames.append((time_s, T_world_given, offset / sigma))
        if len(self._frames) < 4:
            return
        (t0, T0, _), (t1, T1, o1), (t2, T2, o2), (t3, T3, _) = self._frames
        if not 0 < min(t1 - t0, t2 - t1, t3 - t2) <= max(t1 - t0, t2 - t1, t3 - t2) <= _SMOOTH_S:
            return
        # Velocity from one frame before to one after: noise of the poses is then in it and in the offset by chance.
        faster = (twist(T1, T3) / (t3 - t1) - twist(T0, T2) / (t2 - t0)) / sigma
        further = o2 - o1
        self._weigh(faster.reshape(2, 3), further.reshape(2, 3))

    def interrupt(self) -> None:
        """The poses have jumped: what came before tells nothing of velocities from here on."""
        self._last = None
        self._frames.clear()

    def _weigh(self, faster: NDArray[np.float64], further: NDArray[np.float64]) -> None:
        """A change of velocity and of the offset, (2, 3) each: translation and rotation."""
        left = further - (self._estimate - self.delay_s) * faster
        square = (left**2).mean(axis=1)
        self._count += 1
        usual = self._scatter if self._count > _FIRST else np.full(2, np.inf)
        self._scatter += (np.minimum(square, _OUTLIER**2 * usual) - self._scatter) / min(self._count, 30 * _FIRST)
        if self._count <= _FIRST:
            return
        valid = square < _OUTLIER**2 * usual
        weight = valid / np.maximum(self._scatter, 1e-12)
        information = float(weight @ (faster**2).sum(axis=1))
        gradient = float(weight @ (faster * further).sum(axis=1))
        total = self._information + information
        self._estimate += (gradient + information * (self.delay_s - self._estimate)) / total
        self._estimate = float(np.clip(self._estimate, -_MOST * self._sigma, _MOST * self._sigma))
        self._information = min(total, _KNOWN_S**-2)
        doubt = _SURE / np.sqrt(self._information)
        sure = max(0.0, 1.0 - (doubt / self._estimate) ** 2) if self._estimate else 0.0
        if abs(sure * self._estimate - self.delay_s) >= _STEP_S:
            self.delay_s = sure * self._estimate
            self._frames.clear()
