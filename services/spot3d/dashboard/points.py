"""The dashboard's copy of a robot's map: points are updated one by one, and shown in chunks."""

import numpy as np
from numpy.typing import NDArray

from spot3d_schemas import MapChanges

CHUNK = 16_384
"""Points that are sent to browsers together: 150 kB."""
Points = tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint32]]
"""xyz (n, 3), rgb (n, 3), heat (n,) and frequency (n,) of some points, copied."""


class MapCopy:
    """The points of a map by number, and which chunks have changed since they were last shown.

    xyz: (n, 3) float32 m, world; rgb: (n, 3) uint8; heat: (n,) uint8 255ths; frequency: (n,) uint32, 0 = no point.
    left_out: changes of points beyond `limit`, which are not kept.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.generation, self.behind, self.total = 0, 0, 0
        self.left_out = 0
        self.dirty: set[int] = set()
        self._used = 0
        # Untouched pages cost no memory.
        self._xyz = np.zeros((limit, 3), np.float32)
        self._rgb = np.zeros((limit, 3), np.uint8)
        self._heat = np.zeros(limit, np.uint8)
        self._frequency = np.zeros(limit, np.uint32)

    @property
    def chunks(self) -> int:
        """How many chunks there are."""
        return -(-self._used // CHUNK)

    def apply(self, changes: MapChanges) -> bool:
        """Apply an answer; returns whether it is of another map, in which case all points were forgotten first."""
        another = changes.generation != self.generation
        if another:
            self.dirty |= set(range(self.chunks))
            self._frequency[: self._used] = 0
            self._used = self.left_out = 0
        self.generation, self.behind, self.total = changes.generation, changes.behind, changes.total
        kept = changes.number < self.limit
        self.left_out += int(len(kept) - np.count_nonzero(kept))
        rows = changes.number[kept].astype(np.int64)
        if len(rows):
            self._used = max(self._used, int(rows.max()) + 1)
            self._xyz[rows], self._rgb[rows] = changes.xyz[kept], changes.rgb[kept]
            self._heat[rows], self._frequency[rows] = changes.heat[kept], changes.frequency[kept]
            self.dirty |= set(np.unique(rows // CHUNK).tolist())
        return another

    def chunk(self, number: int) -> Points:
        """A chunk's points."""
        return self._points(number * CHUNK, min((number + 1) * CHUNK, self._used))

    def points(self) -> Points:
        """All points."""
        return self._points(0, self._used)

    def _points(self, start: int, end: int) -> Points:
        part = slice(start, end)
        there = self._frequency[part] > 0
        return self._xyz[part][there], self._rgb[part][there], self._heat[part][there], self._frequency[part][there]


def heat_colours(heat: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Colours of heat, 255ths: (n,) uint8 to (n, 3) uint8 RGB, from dark blue over red to yellow."""
    stops = np.array([(24, 28, 68), (92, 30, 130), (214, 52, 84), (255, 146, 32), (255, 240, 120)], np.float32)
    at = heat.astype(np.float32) * ((len(stops) - 1) / 255)
    low = np.minimum(at.astype(np.int64), len(stops) - 2)
    share = (at - low)[..., None]
    colours: NDArray[np.uint8] = np.rint(stops[low] * (1 - share) + stops[low + 1] * share).astype(np.uint8)
    return colours
