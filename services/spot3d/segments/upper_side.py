"""Which side of the image is up: checks the settings against the hot planes of keyframes."""

import math
from collections import Counter, deque

import numpy as np
from numpy.typing import NDArray

IMAGE_UP = {
    "top": np.array((0.0, -1.0, 0.0)),
    "bottom": np.array((0.0, 1.0, 0.0)),
    "left": np.array((-1.0, 0.0, 0.0)),
    "right": np.array((1.0, 0.0, 0.0)),
}
"""The direction of each side of the image in the camera frame, x right and y down."""
CLEARLY = 0.3
"""A support whose normal has this cosine to the direction of the image's upper side is no wall. A wall reaches it if
the camera looks up by 17 degrees, a table whenever the camera looks down by less than 72."""

# In redkitchen, TUM's cabinet and 42 built-in scenes at most 40 % of any 30 successive keyframes, and 60 % of any 20,
# name the same wrong side (in bookcases; in redkitchen 33 and 50 %). With `_ROLL` of 15 degrees: 57 and 80 %, of 20
# degrees: 63 and 95 %. Of the first 30 at least 80 % name the right side in all scenes but bookcases and one bin.
_ROLL = math.sin(math.radians(10))
"""A support's normal points to a side of the image within this sine. Walls that could be taken for one seldom do."""
_REMEMBERED, _FEWEST = 30, 20
"""Number of keyframes remembered, ten seconds, and the fewest that decide."""
_SURE = 0.8
"""Share of the keyframes that must name the same other side."""
_ALIKE = math.cos(math.radians(15))
"""A plane whose normal has this cosine to the known up (`up_direction.py`) is level, whichever side it faces by now."""


def notice(side: str) -> str:
    """Message that another side of the image seems to be up than the settings say, and what to do about it."""
    return (
        f"the {side} side of the image seems to be up: if the camera is mounted that way, set segments.image_up = "
        f'"{side}"; otherwise objects are missed'
    )


def event_of(side: str) -> str:
    """Name of the stage's event that this side seems to be up."""
    return f"{side} side seems up"


class UpperSide:
    """Remembers which side of the image the hottest, possibly level plane of each keyframe faced; it needs no poses.

    found: the side that seems to be up instead of `image_up`; empty while none does. Once found it stays.
    """

    def __init__(self, image_up: str) -> None:
        self._image_up = image_up
        self._sides: deque[str] = deque(maxlen=_REMEMBERED)
        self.found = ""

    def learn(self, planes: NDArray[np.float64], heat: NDArray[np.float64], up: NDArray[np.float64] | None) -> None:
        """Take a keyframe into account.

        planes: (n, 4) camera frame, normals towards the camera; heat: (n,) heat that each holds; up: (3,) unit,
        camera frame, None = unknown. A plane that faces it counts for `image_up`: the camera has been rolled since.
        """
        level = _faced(planes, heat)
        side = "" if level is None else max(IMAGE_UP, key=lambda name: float(IMAGE_UP[name] @ level))
        if level is not None and up is not None and level @ up > _ALIKE:
            side = self._image_up
        self._sides.append(side)
        others = Counter(side for side in self._sides if side not in ("", self._image_up))
        for name, count in others.items():
            if not self.found and len(self._sides) >= _FEWEST and count >= _SURE * len(self._sides):
                self.found = name


def _faced(planes: NDArray[np.float64], heat: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """(3,) normal of the hottest plane that may be level: it faces a side of the image, and that side would be up.

    None if there is no such plane, or one that faces the camera is hotter: seen from straight above, that is the table,
    and a plane that faces a side is the front of an object on it.
    """
    less, more = np.sort(np.abs(planes[:, :2]), axis=1).T
    aside, ahead = (less <= _ROLL) & (more >= CLEARLY), np.hypot(less, more) < CLEARLY
    held = np.where(aside | ahead, heat, 0.0)
    hottest = int(held.argmax()) if held.any() else -1
    return planes[hottest, :3] if hottest >= 0 and aside[hottest] else None
