"""Which points of the 3D heatmap count (paper, Sec. V-C)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.map.map_arrays import FREQUENCY, HEAT, R, X
from spot3d.fusion.settings import FusionSettings
from spot3d.kernel import kernel


@dataclass(frozen=True, slots=True)
class FrequentPoints:
    """Points of the 3D heatmap that were seen often enough.

    xyz: (n, 3) float32 world metres; colour: (n, 3) float32 RGB 0..255; heat: (n,) float32 pseudo-average confidence;
    frequency: (n,) float32 frames.
    """

    xyz: NDArray[np.float32]
    colour: NDArray[np.float32]
    heat: NDArray[np.float32]
    frequency: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.xyz)

    def take(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> "FrequentPoints":
        """The points of these rows."""
        return FrequentPoints(self.xyz[rows], self.colour[rows], self.heat[rows], self.frequency[rows])


def counting(frame_count: int, settings: FusionSettings) -> tuple[float, float]:
    """The least frequency of a point that counts, min(5, 5 % of the frames), and tau (Eq. 15)."""
    least = min(settings.frequency_min, settings.frequency_share * frame_count)
    tau = min(settings.tau, settings.tau_share * frame_count) if settings.tau_share > 0 else settings.tau
    return max(1.0, least), tau


def frequent_points(rows: NDArray[np.float32], frame_count: int, settings: FusionSettings) -> FrequentPoints:
    """Points seen at least min(5, 5 % of the frames) times, with their pseudo-average confidence (Eq. 15).

    rows: (n, 16) float32 map rows, of which columns are copied.
    """
    least, tau = counting(frame_count, settings)
    # Room for all rows: unused pages cost no memory. NumPy's own arrays are on huge pages.
    vectors = [np.empty((len(rows), 3), np.float32) for _ in range(2)]
    scalars = [np.empty(len(rows), np.float32) for _ in range(2)]
    count: int = _copy_frequent(rows, np.float32(least), np.float32(tau), *vectors, *scalars)
    return FrequentPoints(*(column[:count] for column in (*vectors, *scalars)))


@kernel("i8(f4[:,::1], f4, f4, f4[:,::1], f4[:,::1], f4[::1], f4[::1])")
def _copy_frequent(
    rows: NDArray[np.float32],
    least: np.float32,
    tau: np.float32,
    xyz: NDArray[np.float32],
    colour: NDArray[np.float32],
    heat: NDArray[np.float32],
    frequency: NDArray[np.float32],
) -> int:
    """Copy the frequent points and return their number: one pass, as fusing waits for it."""
    k = np.uint64(0)
    for row in range(len(rows)):
        f = rows[row, FREQUENCY]
        if f < least:
            continue
        for axis in range(3):
            xyz[k, axis] = rows[row, X + axis]
            colour[k, axis] = rows[row, R + axis]
        heat[k] = rows[row, HEAT] / (f + tau)
        frequency[k] = f
        k += np.uint64(1)
    return int(k)
