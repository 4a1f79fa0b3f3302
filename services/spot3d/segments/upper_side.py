"""Which side of the image is up: what the settings say, and whether what is hot in the keyframes agrees."""

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
"""The direction in the camera frame, x right and y down, of the side of the image that is up."""
CLEARLY = 0.3
"""A support whose normal has this cosine to the upper side of the image is no wall: a wall has it in a camera that
looks up by 17 degrees, a table in every one that looks down by less than 72."""

# Of redkitchen, TUM's cabinet and 42 built-in scenes at most 40 % of any 30 keyframes in a row, and 60 % of any 20,
# name one wrong side: those of bookcases; 33 and 50 % of redkitchen's do. With a roll of 15 degrees it is 57 and 80 %,
# with 20 degrees 63 and 95 %. Of the first 30 at least 80 % name the right one in all but bookcases and one bin.
_ROLL = math.sin(math.radians(10))
"""What things stand on faces a side of the image to this sine; walls mostly lie aslant if a side is taken for up."""
_REMEMBERED, _FEWEST = 30, 20
"""So many keyframes are remembered, ten seconds, and fewer say nothing."""
_SURE = 0.8
"""Share of the keyframes that name the same other side."""
_ALIKE = math.cos(math.radians(15))
"""A plane that is this near to level in the world (see `upward`) faces up, wherever that is in the image by now."""


def notice(side: str) -> str:
    """That another side of the image seems to be up than the settings say, and what to do about it, in words."""
    return (
        f"the {side} side of the image seems to be up: if the camera is mounted so, set segments.image_up = "
        f'"{side}", or objects are missed'
    )


def event_of(side: str) -> str:
    """How it is counted among a stage's events that this side seems to be up."""
    return f"{side} side seems up"


class UpperSide:
    """Remembers which side of the image what is hot and may be level faced in keyframes; no pose is needed for that.

    found: the side that seems to be up, in the place of `image_up`; empty as long as none does. Once found it stays.
    """

    def __init__(self, image_up: str) -> None:
        self._image_up = image_up
        self._sides: deque[str] = deque(maxlen=_REMEMBERED)
        self.found = ""

    def learn(self, planes: NDArray[np.float64], heat: NDArray[np.float64], up: NDArray[np.float64] | None) -> None:
        """Take a keyframe into account.

        planes: (n, 4) camera frame, normals towards the camera; heat: (n,) what each holds; up: (3,) unit, camera
        frame: what is known to be up. A camera that has been rolled since it began is mounted as the settings say.
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
    """(3,) the normal of the hottest plane that may be level: it faces a side of the image, and that side would be up.

    None where there is none, or what faces the camera itself is hotter: seen from straight above that is the table, and
    what faces a side is the front of something on it.
    """
    less, more = np.sort(np.abs(planes[:, :2]), axis=1).T
    aside, ahead = (less <= _ROLL) & (more >= CLEARLY), np.hypot(less, more) < CLEARLY
    held = np.where(aside | ahead, heat, 0.0)
    hottest = int(held.argmax()) if held.any() else -1
    return planes[hottest, :3] if hottest >= 0 and aside[hottest] else None
