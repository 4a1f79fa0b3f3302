"""How noisy a depth camera is: the standard deviation of its depth as a function of range, with presets."""

import math
from typing import Annotated, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from spot3d.zero_or_at_least import zero_or_at_least
from spot3d_schemas import DepthNoise as NoiseMessage
from spot3d_schemas.limits import MAX_DEPTH_NOISE, MAX_LEAST_NOISY_RANGE, MIN_DEPTH_NOISE

Metres = TypeVar("Metres", float, NDArray[np.float32], NDArray[np.float64])


class DepthNoise(NamedTuple):
    """sigma(z) = floor + growth * (z - at)^2, metres: every kind of depth camera is near to such a parabola.

    floor: metres; growth: metres per square metre; at: the range of least noise, metres.
    """

    floor: float
    growth: float
    at: float

    def sigma(self, z: Metres) -> Metres:
        """Standard deviation of depth z, metres."""
        return self.floor + self.growth * (z - self.at) ** 2

    def coefficients(self) -> tuple[np.float32, np.float32, np.float32]:
        """The `noise` argument of `sensor.axial_noise_kernel`."""
        return np.float32(self.floor), np.float32(self.growth), np.float32(self.at)


def checked_noise(floor: float, growth: float, at: float) -> DepthNoise:
    """The noise with these coefficients. Raises ValueError if no message may state them: no camera has them."""
    noise = DepthNoise(floor, growth, at)
    try:
        NoiseMessage(**noise._asdict())
    except ValueError:
        raise ValueError(
            f"depth noise must have a floor of {MIN_DEPTH_NOISE:g} to {MAX_DEPTH_NOISE:g} m, a growth of 0 to "
            f"{MAX_DEPTH_NOISE:g}, its minimum at 0 to {MAX_LEAST_NOISY_RANGE:g} m, and at most {MAX_DEPTH_NOISE:g} "
            f"m at 1 m; got {floor:g}, {growth:g}, {at:g}; give them in metres"
        ) from None
    return noise


KINECT_V1 = DepthNoise(0.0012, 0.0019, 0.4)
"""Nguyen, Izadi and Lovell 2012 (Eq. 3), quantisation included; the default where an input states nothing."""

TIME_OF_FLIGHT = DepthNoise(0.001, 0.0004, 0.5)
"""About that of Azure Kinect's narrow view on matt surfaces: 1 mm near, 2 to 3 mm at 2.5 m."""

GRAZING_COS = 0.17
"""Hardly a camera measures a surface that it sees at more than 80 degrees. Steeper depth, which changes by a hundredth
of itself from pixel to pixel at a focal length of 570 pixels, mixes an edge with what lies behind it. With 83, 80, 75
degrees, where depth is mixed at edges: IoU 0.66, 0.68, 0.65 on redkitchen (0.56 with all pixels) and 0.46, 0.61, 0.57
on clutter (with no pixel moved to a surface before). Elsewhere it hardly changes."""
GrazingCos = Annotated[
    float,
    Field(
        ge=0,
        lt=1,
        description="cosine of the viewing angle below which sloping depth counts as mixed pixels of an edge: "
        "removed, or moved to one of its surfaces; 0: off",
    ),
    zero_or_at_least(0.01),
]
"""The setting of stages that leave out such depth. Below 0.01, within 0.6 degrees of edge-on, hardly any is."""

RANGE_MAX = 2.5
"""Depth beyond this shows no objects, metres: a Kinect's noise is half of eps_min there, and surfaces come apart. With
2.5, 3, 3.5 m on two desks and on four floors seen from a robot's and from a drone's height: detection 0.77, 0.87, 0.82,
success 0.76, 0.75, 0.69. With 3 m success on five desks is 0.75 instead of 0.84. On redkitchen F is the same, but each
object gets 1.6 instead of 1.3 numbers, and with KISS-ICP's poses three of four are found.
"""

_MILLIMETRE_STEPS = 0.001 / math.sqrt(12)
SUBPIXEL = 0.08
"""Standard deviation of disparity on textured surfaces, pixels: what Intel states for the D400 series."""


_BASELINE_MAX = 2.0
"""No depth camera is wider, metres: a larger number is in millimetres, or a focal length."""


def stereo_noise(baseline_m: float, focal_px: float, subpixel: float = SUBPIXEL) -> DepthNoise:
    """Noise of a stereo camera: z^2 * subpixel / (focal length * baseline), and depth in steps of a millimetre.

    focal_px: of the depth image at the size at which disparity is computed. Raises ValueError, also for a baseline in
    millimetres.
    """
    if not (0 < baseline_m <= _BASELINE_MAX and focal_px > 0 and subpixel > 0):
        raise ValueError(
            f"baseline (metres, at most {_BASELINE_MAX:g}), focal length and subpixel (pixels) must be positive; got "
            f"{baseline_m:g}, {focal_px:g}, {subpixel:g}"
        )
    return checked_noise(_MILLIMETRE_STEPS, subpixel / (focal_px * baseline_m), 0.0)


# Focal lengths of 848 pixels across, as the data sheets' fields of view give them: 65, 87 and 87 degrees.
PRESETS = {
    "kinect-v1": KINECT_V1,
    "d415": stereo_noise(0.055, 848 / 2 / math.tan(math.radians(65 / 2))),
    "d435": stereo_noise(0.050, 848 / 2 / math.tan(math.radians(87 / 2))),
    "d455": stereo_noise(0.095, 848 / 2 / math.tan(math.radians(87 / 2))),
    "tof": TIME_OF_FLIGHT,
}
"""Cameras by name."""


def parse_noise(text: str) -> DepthNoise:
    """A preset by name, `stereo:BASELINE,FOCAL[,SUBPIXEL]`, or `FLOOR,GROWTH,AT`. Raises ValueError."""
    if text in PRESETS:
        return PRESETS[text]
    kind, _, numbers = text.rpartition(":")
    try:
        values = [float(number) for number in numbers.split(",")]
    except ValueError:
        values = []
    if kind == "stereo" and len(values) in (2, 3):
        return stereo_noise(*values)
    if not kind and len(values) == 3:
        return checked_noise(*values)
    raise ValueError(
        f"{text!r} is not a depth noise; give {', '.join(PRESETS)}, stereo:BASELINE,FOCAL or "
        "stereo:BASELINE,FOCAL,SUBPIXEL (metres, pixels), or FLOOR,GROWTH,AT (metres)"
    )
