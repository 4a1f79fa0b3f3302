"""Which points of the 3D heatmap count (paper, Sec. IV-C)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.fusion.heatmap3d import FREQUENCY, HEAT, NORMAL, R, X
from spot3d.fusion.settings import FusionSettings


@dataclass(frozen=True, slots=True)
class MapPoints:
    """Points of the 3D heatmap that were seen often enough.

    xyz: (n, 3) float32 world metres; normal: (n, 3) float32 unit, zero where unknown; colour: (n, 3) float32
    RGB 0..255; heat: (n,) float32 pseudo-average confidence; frequency: (n,) float32 frames.
    """

    xyz: NDArray[np.float32]
    normal: NDArray[np.float32]
    colour: NDArray[np.float32]
    heat: NDArray[np.float32]
    frequency: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.xyz)

    def take(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> "MapPoints":
        """The points of these rows."""
        return MapPoints(self.xyz[rows], self.normal[rows], self.colour[rows], self.heat[rows], self.frequency[rows])


def frequent_points(rows: NDArray[np.float32], frame_count: int, settings: FusionSettings) -> MapPoints:
    """Points seen at least min(5, 5 % of the frames) times, with their pseudo-average confidence (Eq. 14).

    rows: (n, 16) float32 map rows, of which columns are copied.
    """
    least = min(settings.frequency_min, settings.frequency_share * frame_count)
    kept = rows[rows[:, FREQUENCY] >= max(1.0, least)]
    normal = kept[:, NORMAL : NORMAL + 3]
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    frequency = kept[:, FREQUENCY]
    return MapPoints(
        np.ascontiguousarray(kept[:, X : X + 3]),
        normal / np.maximum(length, np.float32(1e-9)),
        np.ascontiguousarray(kept[:, R : R + 3]),
        kept[:, HEAT] / (frequency + np.float32(settings.tau)),
        frequency.copy(),
    )
